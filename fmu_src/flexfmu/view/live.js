// The body alive: steps of its FMU as a master takes them, and pulls with the pointer.
const unpack = async text => new Uint8Array(await new Response(new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
const SPEEDS = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4];
// Steps in a period of the first mode, its frequency on the screen (Hz), time for steps of a picture (ms), how far fingers miss (px).
const STEPS = 400, SHOWN = 0.8, BUDGET = 12, NEAR = { mouse: 26, pen: 30, touch: 44 };
const SAMPLES = 400, FOLLOW = 0.06, CHASE = 0.6;

class Live {
  static async open(spec) {
    const parts = {}, told = [];
    for (const [name, text] of Object.entries(spec.parts)) parts[name] = await unpack(text);
    const { core: wasm, numbers, stress, ...files } = parts;
    const core = await Core.open(wasm, files, (name, status, text) => told.push({ name, status, text }));
    return new Live(spec, core, told, new Float32Array(numbers.buffer), stress && new Float32Array(stress.buffer));
  }
  constructor(spec, core, told, numbers, stressRows) {
    Object.assign(this, { live: true, name: "live", note: "", position: [0], factor: 1, peak: 0, cyclic: false, spec, told, paused: false, speed: 1, debt: 0, ghostShown: true, stressRows });
    const number = name => spec.variables.indexOf(name), xyz = name => ["x", "y", "z"].map(axis => number(`${name}.${axis}`));
    this.interfaces = spec.interfaces.map((name, k) => ({ name, stiffness: spec.stiffness[k], force: xyz(`${name}.force`), motion: [...xyz(`${name}.displacement`), ...xyz(`${name}.rotation`)] }));
    this.errorNumber = number("diagnostics.error");
    this.first = spec.stiffness.indexOf(Math.min(...spec.stiffness));
    this.h = 1 / (spec.frequency * STEPS);
    this.speed = SPEEDS.find(s => s * spec.frequency <= SHOWN * 1.5) ?? SPEEDS.at(-1);
    this.body = new Body(core, "body", spec.guid, []);
    this.body.watch(spec.sizes, spec.on, numbers);
    if (spec.parts["linear.prog"]) {
      this.line = new Body(core, "linear", spec.guid, [[number("method"), "linear"]]);
      this.line.surface = [core.longs([0, ...spec.sizes.slice(1)]), ...this.body.surface.slice(1)]; this.line.points = this.body.points;
      this.ghostPlaces = new Float32Array(points.length);
    }
    this.all = this.interfaces.flatMap(i => i.motion);
    this.size = Math.hypot(...sub(high, low));
    this.fresh();
  }
  get ghost() { return this.ghostShown && this.line && !this.line.lost && this.moving ? this.ghostPlaces : null; }
  fresh() {
    this.pull = null; this.moving = false; this.refused = ""; this.warned = ""; this.critical = ""; this.error = null; this.told.length = 0; this.history = []; this.top = 1e-9 * this.size; this.stressTop = 1; this.debt = 0;
    for (const one of [this.body, this.line]) if (one) { one.start(); one.lost = false; one.before = null; }
    this.low = [0, 1, 2].map(() => -0.1 * this.size); this.high = [0, 1, 2].map(() => 0.1 * this.size);
    this.read();
  }
  read() {
    this.motion = this.body.get(this.all);
    this.lineMotion = this.line ? this.line.get(this.all) : null;
    // The marks of this page are the interfaces, then the supports, which stay.
    this.ends = this.interfaces.map((_, k) => DATA.markPoints[k].map((x, c) => x + this.motion[6 * k + c]));
    this.markNow = [...this.ends, ...DATA.markPoints.slice(this.ends.length)];
  }

  // Forces of the pull on one body: F = k (pointer - x) in the plane of the screen, x as it will be when the step ends.
  force(one) {
    const pull = this.pull, own = this.interfaces[pull.k], u = one.get(own.motion.slice(0, 3));
    const ahead = one.before ? u.map((x, c) => 2 * x - one.before[c]) : u;
    one.before = u;
    const gap = pull.aim.map((x, c) => x - DATA.markPoints[pull.k][c] - ahead[c]), out = dot(gap, turn[2]);
    return gap.map((x, c) => own.stiffness * (x - out * turn[2][c]));
  }
  take_(one, loaded) {
    if (this.pull) one.set(this.interfaces[this.pull.k].force, this.load = this.force(one));
    else if (loaded) for (const i of this.interfaces) one.set(i.force, [0, 0, 0]);
    return one.step(this.h);
  }
  step() {
    const let_go = this.released;
    this.released = false;
    if (this.line && !this.line.lost) this.line.lost = !this.take_(this.line, let_go);
    if (this.take_(this.body, let_go)) return true;
    // The state is the last good one: from there it goes on without the pull.
    const last = this.told.findLast(line => line.name === "body" && line.status > 1);
    if (!this.refused) this.refused = last ? last.text : "the body refused a step";
    if (!this.pull) this.paused = true;
    this.letGo();
    return false;
  }
  // What passes between two pictures; whether anything moved.
  advance(time) {
    const real = Math.min((time - (this.last ?? time)) / 1000, 0.05);
    this.last = time;
    if (this.paused || !this.moving) return this.tell() || !this.touched;
    if (this.pull) { const w = 1 - Math.exp(-real / FOLLOW), goal = this.goal(); this.pull.aim = this.pull.aim.map((x, c) => x + w * (goal[c] - x)); }
    const end = performance.now() + BUDGET;
    this.debt = Math.min(this.debt + real * this.speed / this.h, 1e6);
    while (this.debt >= 1 && performance.now() < end) { this.debt -= 1; if (!this.step()) break; }
    if (this.debt >= 1) this.debt = 0;
    this.read();
    if (!this.pull && this.spec.free) this.chase(1 - Math.exp(-real / CHASE));
    if (this.errorNumber >= 0) [this.error, this.bound] = this.body.error(this.errorNumber);
    this.history.push([this.body.time, this.value(this.motion), this.lineMotion && this.value(this.lineMotion)]);
    if (this.history.length > SAMPLES) this.history.shift();
    this.tell();
    return true;
  }
  // The camera goes with a free body that nothing holds.
  chase(w) {
    const mean = [0, 1, 2].map(c => this.ends.reduce((s, p, k) => s + p[c] - DATA.markPoints[k][c], 0) / this.ends.length);
    centre = centre.map((x, c) => x + w * (0.5 * (low[c] + high[c]) + mean[c] - x));
  }
  shape(now, moved) {
    const places = this.body.places();
    this.low = [Infinity, Infinity, Infinity]; this.high = [-Infinity, -Infinity, -Infinity];
    let most = 0;
    for (let i = 0; i < N; i++) {
      let s = 0;
      for (let k = 0; k < 3; k++) {
        const u = places[3 * i + k] - points[3 * i + k];
        now[3 * i + k] = places[3 * i + k]; s += u * u;
        this.low[k] = Math.min(this.low[k], u); this.high[k] = Math.max(this.high[k], u);
      }
      moved[i] = Math.sqrt(s); most = Math.max(most, moved[i]);
    }
    for (let k = 0; k < 3; k++) { this.low[k] -= 0.1 * this.size; this.high[k] += 0.1 * this.size; }
    if (most > this.top) { this.top = 1.25 * most; words(); }
    if (this.ghost) this.ghostPlaces.set(this.line.places());
  }

  // Von Mises stress at the surface's points, N/m².
  stress() {
    const rows = this.stressRows, m = rows.length / (6 * N), q = this.body.modes(m), value = new Float32Array(N), s = new Float64Array(6);
    let most = 0;
    for (let i = 0, at = 0; i < N; i++) {
      for (let k = 0; k < 6; k++) { let sum = 0; for (let j = 0; j < m; j++) sum += rows[at++] * q[j]; s[k] = sum; }
      const [xx, yy, zz, xy, yz, zx] = s;
      value[i] = Math.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * (xy * xy + yz * yz + zx * zx));
      most = Math.max(most, value[i]);
    }
    if (most > this.stressTop) { this.stressTop = 1.25 * most; words(); }
    return value;
  }
  // Colours go by the bound, as warnings do.
  get errorTint() { return ERROR_TINTS[this.error === null ? 0 : this.error < 0 || this.bound > 0.03 ? 2 : this.bound > 0.01 ? 1 : 0]; }

  // Pointer and keyboard.
  at(e) { const r = area.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; }
  // Where a point of the screen is, as deep as the interface.
  goal() {
    const pull = this.pull; if (pull.fixed) return pull.fixed;
    const a = (2 * pull.pixel[0] / area.clientWidth - 1 - shiftX) / scaleX, b = (1 - 2 * pull.pixel[1] / area.clientHeight - shiftY) / scaleY;
    const c = dot(turn[2], sub(this.markNow[pull.k], centre));
    return centre.map((x, k) => x + a * turn[0][k] + b * turn[1][k] + c * turn[2][k]);
  }
  begin(k, more) { this.pull = { k, aim: [...this.markNow[k]], ...more }; if (!this.moving) { this.moving = this.touched = true; words(); } this.refused = ""; for (const one of [this.body, this.line]) if (one) one.before = null; }
  take(e) {
    const [x, y] = this.at(e), w = area.clientWidth, h = area.clientHeight;
    const far = this.ends.map(p => { const s = screen(p, w, h); return Math.hypot(s[0] - x, s[1] - y); });
    const k = far.indexOf(Math.min(...far));
    if (far[k] > (NEAR[e.pointerType] ?? NEAR.mouse)) return false;
    this.begin(k, { pixel: [x, y], pointer: e.pointerId });
    return true;
  }
  drag(e) {
    if (this.pull && this.pull.pointer === e.pointerId) { this.pull.pixel = this.at(e); return true; }
    return false;
  }
  release(e) { if (this.pull && this.pull.pointer === e.pointerId) this.letGo(); }
  letGo() { this.pull = null; this.released = true; this.load = null; }
  key(e) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (way) {
      if (!this.pull) this.begin(this.chosen(), { fixed: [...this.markNow[this.chosen()]] });
      if (this.pull.fixed) this.pull.fixed = this.pull.fixed.map((x, c) => x + 0.02 * this.size * (way[0] * turn[0][c] + way[1] * turn[1][c]));
    } else if (e.key === "Escape") this.letGo();
    else if (e.key === " " && !e.target.closest("button")) this.pause();
    else if (e.key === "r") this.reset();
    else if (e.key === "l" && this.line) this.flip();
    else return;
    e.preventDefault();
  }
  pause() { this.paused = !this.paused; this.told_ = ""; }
  reset() { this.fresh(); this.paused = false; if (this.spec.free) fit(); dirty = true; words(); }
  flip() { this.ghostShown = !this.ghostShown; $("linear").setAttribute("aria-pressed", this.ghostShown); dirty = true; }

  // The plot's output: size of displacement, its parts, size of rotation.
  chosen() { return Math.floor(+$("output").value / 5); }
  value(motion) {
    const choice = +$("output").value, k = 6 * Math.floor(choice / 5), part = choice % 5;
    if (part === 0) return Math.hypot(...motion.slice(k, k + 3));
    if (part === 4) return Math.hypot(...motion.slice(k + 3, k + 6)) * 180 / Math.PI;
    return motion[k + part - 1];
  }

  // Words and pictures around.
  controls() {
    const tools = $("liveTools"), panel = document.createElement("div"), names = ["displacement", "displacement x", "displacement y", "displacement z", "rotation"];
    tools.hidden = false;
    tools.innerHTML = `<button id="pause" title="space"></button><button id="reset" title="r">reset</button>
      <button id="linear" title="l" aria-pressed="true"><i></i>linear</button><label>speed <select id="speed"></select></label>`;
    panel.id = "livePanel";
    panel.innerHTML = `<div id="trust"><span>error</span><i><u></u><b></b></i></div><select id="output" aria-label="output of the plot"></select><canvas id="plot"></canvas>`;
    area.append(panel);
    const banner = document.createElement("div"); banner.id = "refused"; banner.hidden = true; banner.setAttribute("role", "status");
    banner.innerHTML = "<b>Refused.</b> <span></span> <button>reset</button>"; area.append(banner); banner.querySelector("button").onclick = () => this.reset();
    options($("speed"), SPEEDS.map(s => [String(s), s === 1 ? "real time" : `1 / ${Math.round(1 / s)}`]), String(this.speed));
    options($("output"), this.interfaces.flatMap((i, k) => names.map((n, j) => [String(5 * k + j), `${i.name} ${n}`])), String(5 * this.first));
    $("speed").onchange = e => { this.speed = +e.target.value; };
    $("output").onchange = () => { this.history = []; };
    $("pause").onclick = () => this.pause(); $("reset").onclick = () => this.reset(); $("linear").onclick = () => this.flip();
    $("linear").hidden = !this.line; $("trust").hidden = this.errorNumber < 0;
  }
  // Said anew where it changed.
  tell() {
    const hint = matchMedia("(pointer: coarse)").matches ? "Take an orange point and pull." : "Take an orange point and pull, or press the arrow keys.";
    const warning = this.told.findLast(line => line.name === "body" && line.status === 1);
    // It is said once, while the motion goes on.
    if (warning) this.warned = `at ${this.body.time.toPrecision(3)} s: ${warning.text}`;
    if (warning && /critical load/.test(warning.text)) this.critical = ` Before it: ${warning.text}.`;
    this.told.length = 0;
    const text = !this.moving ? hint : `${this.body.time.toPrecision(4)} s${this.paused ? ", paused" : ""}${this.warned && !this.refused ? ` — ${this.warned}` : ""}`;
    if (text === this.said && this.wasRefused === this.refused && this.wasPaused === this.paused) return false;
    [this.said, this.wasRefused, this.wasPaused] = [text, this.refused, this.paused];
    $("note").textContent = text; $("livePanel").hidden = !this.moving;
    $("pause").textContent = this.paused ? "▶" : "❚❚"; $("pause").setAttribute("aria-label", this.paused ? "go on" : "pause");
    $("refused").hidden = !this.refused;
    $("refused").querySelector("span").textContent = this.refused && `${this.refused}.${this.critical} The body is in its last good state.`;
    return true;
  }
  annotate(g, w, h, halo) {
    // Rings that invite, until something was taken.
    if (!this.touched) for (const p of this.ends) {
      const t = performance.now() / 1200 % 1, [x, y] = screen(p, w, h);
      g.globalAlpha = 1 - t; g.strokeStyle = "#d55e00"; g.lineWidth = 2.5; g.beginPath(); g.arc(x, y, 6 + 22 * t, 0, 7); g.stroke(); g.globalAlpha = 1;
    }
    if (this.pull && this.load) {
      const from = screen(this.markNow[this.pull.k], w, h), to = screen(this.pull.aim, w, h), long = Math.hypot(to[0] - from[0], to[1] - from[1]);
      if (long > 6) {
        const [x, y] = [(to[0] - from[0]) / long, (to[1] - from[1]) / long];
        g.strokeStyle = g.fillStyle = ink("accent"); g.lineWidth = 3; g.beginPath(); g.moveTo(...from); g.lineTo(to[0] - 8 * x, to[1] - 8 * y); g.stroke();
        g.beginPath(); g.moveTo(...to); g.lineTo(to[0] - 12 * x - 5 * y, to[1] - 12 * y + 5 * x); g.lineTo(to[0] - 12 * x + 5 * y, to[1] - 12 * y - 5 * x); g.fill();
        const force = Math.hypot(...this.load), [f, unit] = force >= 1e6 ? [1e-6, "MN"] : force >= 1e3 ? [1e-3, "kN"] : [1, "N"];
        // Beyond the arrow, where the interface's name is not.
        const far = Math.max(long, 18) + 14, place = [from[0] + far * x + (x < 0 ? -50 : 4), from[1] + far * y + (Math.abs(y) < 0.5 ? 14 : 0)];
        halo(`${(f * force).toPrecision(3)} ${unit}`, Math.max(10, Math.min(place[0], w - 70)), Math.max(12, Math.min(place[1], h - 12)), ink("ink"));
      }
    }
    if (this.error !== null) {
      const says = x => x > 0.1 ? ">\u00a010\u00a0%" : `${+(100 * x).toPrecision(x < 1e-3 ? 1 : 2)}\u00a0%`;
      $("trust").querySelector("span").textContent = this.error < 0 ? "deflection error unknown" : `deflection error ${says(this.error)}, bound ${says(this.bound)}`;
      for (const [name, x] of [["b", this.error], ["u", this.bound]]) {
        const bar = $("trust").querySelector(name); bar.style.width = `${100 * (this.error < 0 ? 1 : Math.min(1, x / 0.05))}%`; bar.style.background = this.errorTint;
      }
    }
    this.plot();
  }
  plot() {
    const c = $("plot"), ratio = Math.min(window.devicePixelRatio || 1, 2), w = c.clientWidth, h = c.clientHeight, g = c.getContext("2d"), part = +$("output").value % 5;
    c.width = Math.round(w * ratio); c.height = Math.round(h * ratio); g.setTransform(ratio, 0, 0, ratio, 0, 0);
    const some = this.history, shown = this.line && this.ghostShown && !this.line.lost ? [2, 1] : [1];
    if (some.length < 2) return;
    let least = 0, most = 0;
    for (const row of some) for (const k of shown) { least = Math.min(least, row[k]); most = Math.max(most, row[k]); }
    if (most - least < 1e-30) return;
    const begin = some[0][0], span = some.at(-1)[0] - begin, x = t => (t - begin) / span * w, y = v => h - 6 - (v - least) / (most - least) * (h - 12);
    g.strokeStyle = ink("line"); g.lineWidth = 1; g.beginPath(); g.moveTo(0, y(0)); g.lineTo(w, y(0)); g.stroke();
    for (const k of shown) {
      g.strokeStyle = ink(k === 1 ? "accent" : "ghost"); g.lineWidth = k === 1 ? 2 : 1.2; g.beginPath();
      some.forEach((row, i) => g[i ? "lineTo" : "moveTo"](x(row[0]), y(row[k]))); g.stroke();
    }
    const largest = Math.max(most, -least), [f, unit] = part === 4 ? [1, "°"] : lengthUnit(largest);
    g.font = "12px system-ui, sans-serif"; g.textBaseline = "top"; g.fillStyle = ink("dim"); g.fillText(`${number(f * (most >= -least ? most : least))} ${unit}`, 3, 2);
  }
}

async function wake() {
  try {
    live = await Live.open(DATA.live);
    DATA.cases.push(live); live.controls(); live.tell(); choose(0); document.body.dataset.live = "yes";
  } catch (error) { $("note").textContent = `This browser cannot run the body: ${error.message}`; }
}
wake();
