// The core in a page: FMI 2.0 for co-simulation as a master calls it, through WebAssembly.
class Core {
  // `files` are those of the FMU's resources by name; `log` is told (instance, status, text).
  static async open(wasm, files, log) {
    const core = new Core();
    const { instance } = await WebAssembly.instantiate(wasm, { page: {
      log: (to, name, status, category, message) => log(core.text(name), status, core.text(message).replaceAll("%%", "%")) } });
    core.call = instance.exports;
    core.call._initialize();
    for (const [name, bytes] of Object.entries(files)) { const at = core.call.fmi2FlexfmuFile(core.put(name), bytes.length); core.bytes.set(bytes, at); }
    return core;
  }
  // Memory grows: views of it are made anew.
  get bytes() { return new Uint8Array(this.call.memory.buffer); }
  whole(at, count) { return new Uint32Array(this.call.memory.buffer, at, count); }
  real(at, count) { return new Float64Array(this.call.memory.buffer, at, count); }
  room(bytes) { return this.call.fmi2FlexfmuRoom(bytes); }
  text(at) { const bytes = this.bytes; return new TextDecoder().decode(bytes.slice(at, bytes.indexOf(0, at))); }
  put(text) { const bytes = new TextEncoder().encode(text + "\0"), at = this.room(bytes.length); this.bytes.set(bytes, at); return at; }
  reals(values) { const at = this.room(8 * values.length); this.real(at, values.length).set(values); return at; }
  longs(values) { const at = this.room(8 * values.length); new BigInt64Array(this.call.memory.buffer, at, values.length).set(Array.from(values, BigInt)); return at; }
}

// An instance of the body, with variables by their value references.
class Body {
  constructor(core, name, guid, parameters) {
    this.core = core; this.parameters = parameters; this.most = 0;
    const back = core.room(20);
    core.whole(back, 5).set([core.call.fmi2FlexfmuLogger(), 0, 0, 0, 0]);
    this.handle = core.call.fmi2Instantiate(core.put(name), 1, core.put(guid), core.put("/"), back, 0, 0);
    if (!this.handle) throw new Error(`${name}: no instance`);
    this.start();
  }
  start() {
    this.call("fmi2Reset");
    for (const [reference, text] of this.parameters) { const at = this.core.put(text); this.place([reference]); this.core.whole(this.values, 1)[0] = at; this.call("fmi2SetString", this.references, 1, this.values); }
    this.call("fmi2SetupExperiment", 0, 0, 0, 0, 0);
    this.call("fmi2EnterInitializationMode"); this.call("fmi2ExitInitializationMode");
    this.time = 0;
  }
  // Status of a call; those worse than a warning but refused steps end the page's run.
  call(name, ...words) {
    const status = this.core.call[name](this.handle, ...words);
    if (status > 1 && name !== "fmi2DoStep") throw new Error(`${name}: status ${status}`);
    return status;
  }
  place(references) {
    if (references.length > this.most) { this.most = references.length; this.references = this.core.room(4 * this.most); this.values = this.core.room(8 * this.most); }
    this.core.whole(this.references, references.length).set(references);
  }
  set(references, values) { this.place(references); this.core.real(this.values, values.length).set(values); this.call("fmi2SetReal", this.references, references.length, this.values); }
  get(references) { this.place(references); this.call("fmi2GetReal", this.references, references.length, this.values); return this.core.real(this.values, references.length).slice(); }
  // Whether a step was taken; a refused one leaves the state as it was.
  step(length) { const taken = this.call("fmi2DoStep", this.time, length, 1) <= 1; if (taken) this.time += length; return taken; }
  // Where the surface's points are, (3 n).
  watch(sizes, on, numbers) { this.surface = [this.core.longs(sizes), this.core.longs(on), this.core.reals(numbers), this.core.room(8 * sizes[2] + 8), this.core.room(24 * sizes[1])]; this.points = sizes[1]; }
  // Estimate of the displacements' error over the largest deflection, and its bound.
  error(reference) { return [this.get([reference])[0], this.core.call.fmi2FlexfmuBound(this.handle)]; }
  modes(count) { this.coordinates ??= this.core.room(8 * count); this.call("fmi2FlexfmuModes", this.coordinates, count); return this.core.real(this.coordinates, count); }
  places() { this.call("fmi2FlexfmuSurface", ...this.surface); return this.core.real(this.surface[4], 3 * this.points); }
}
