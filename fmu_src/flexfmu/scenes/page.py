"""A page of a sweep's records to look into: one HTML file with its data, drawing and script inside."""

import html
import json
import math
from collections.abc import Sequence

from .records import Record

_FILTERS = ("kinematics", "frames", "basis", "modes", "loads", "stiffness", "mass")
_COSTS = {
    "step_us": "time of a step, bare model / µs",
    "fmu_us": "time of a step through the FMU / µs",
    "fmu_ratio": "time of a step over that of an empty FMU",
    "modal_bytes": "modal file / bytes",
    "mode_count": "modes",
    "build_s": "time to build / s",
}
_ERRORS = {
    "static_displacement": "static displacement error",
    "static_rotation": "static rotation error",
    "transient_displacement": "displacement error over time, rms",
    "transient_rotation": "rotation error over time, rms",
    "share": "error over the scene's tolerance",
}


def page(rows: Sequence[Record], title: str) -> str:
    """Text of the page.

    Parameters
    ----------
    rows : sequence of Record
    title : str

    Returns
    -------
    str
    """
    names = (
        *_FILTERS,
        *_COSTS,
        *_ERRORS,
        "static_at",
        "transient_at",
        "limited_by",
        "frame_count",
        "iterations",
        "label",
    )
    data = [{name: _plain(getattr(row, name)) for name in names} for row in rows]
    offered = {
        kind: {name: words for name, words in axes.items() if any(_drawable(row[name]) for row in data)}
        for kind, axes in (("costs", _COSTS), ("errors", _ERRORS))
    }
    content = {"rows": data, "filters": _FILTERS, **offered}
    # Nothing in the data may end the script.
    text = json.dumps(content, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    return _PAGE.replace("@TITLE@", html.escape(title)).replace("@DATA@", text)


def _plain(value: object) -> object:
    """JSON knows numbers that are finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _drawable(value: object) -> bool:
    return isinstance(value, (int, float)) and value > 0


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>@TITLE@</title>
<style>
body { font: 14px/1.4 system-ui, sans-serif; margin: 1.2em; color: #222; }
h1 { font-size: 1.2em; margin: 0 0 .6em; }
#all { display: flex; gap: 1.5em; flex-wrap: wrap; align-items: flex-start; }
#choices { width: 15em; }
fieldset { border: 1px solid #ccc; margin: 0 0 .6em; padding: .2em .7em .4em; }
legend { font-weight: 600; padding: 0 .3em; }
label { display: block; white-space: nowrap; }
select { width: 100%; margin-bottom: .6em; }
#tip { position: fixed; display: none; background: #fffffff2; border: 1px solid #999; padding: .4em .6em;
  pointer-events: none; font-size: 12px; white-space: pre; box-shadow: 0 1px 4px #0003; }
svg { border: 1px solid #ddd; background: #fff; }
.grid { stroke: #e4e4e4; }
.front { fill: none; stroke: #000; }
text { font: 12px system-ui, sans-serif; fill: #333; }
circle { stroke-width: 1.4; cursor: pointer; }
table { border-collapse: collapse; margin-top: .8em; font-size: 13px; }
td, th { padding: .15em .8em .15em 0; text-align: left; border-bottom: 1px solid #eee; }
</style>
</head>
<body>
<h1>@TITLE@</h1>
<div id="all">
<div id="choices">
<label for="error">error</label><select id="error"></select>
<label for="cost">cost</label><select id="cost"></select>
<label><input type="checkbox" id="met"> only what meets the tolerance</label>
<div id="filters"></div>
</div>
<div><svg id="picture" width="860" height="540" role="img" aria-label="error against cost"></svg>
<div id="front"></div></div>
</div>
<div id="tip"></div>
<script id="data" type="application/json">@DATA@</script>
<script>
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const space = "http://www.w3.org/2000/svg", box = { left: 75, right: 20, top: 15, bottom: 48, width: 860, height: 540 };
const byId = (id) => document.getElementById(id), svg = byId("picture"), tip = byId("tip");
const off = {};
const turned = data.rows.filter((r) => r.kinematics === "corotated");
const counts = [...new Set(turned.map((r) => r.frames))].sort((a, b) => a - b);
const within = (row) => row.share !== null && row.share <= 1;
function colour(row) {
  if (row.kinematics === "linear") return "#888";
  if (row.kinematics === "literal") return "#d62728";
  if (row.kinematics === "secant") return "#e377c2";
  const place = counts.length > 1 ? counts.indexOf(row.frames) / (counts.length - 1) : 1;
  return `hsl(${70 + 200 * place} 70% ${48 - 12 * place}%)`;
}
function make(name, attributes, text) {
  const one = document.createElementNS(space, name);
  for (const key in attributes) one.setAttribute(key, attributes[key]);
  if (text !== undefined) one.textContent = text;
  svg.appendChild(one);
  return one;
}
function short(x) { return x === null || x === undefined ? "–" : Number(x.toPrecision(3)).toString(); }
function offer(id, choices) {
  for (const name in choices) byId(id).add(new Option(choices[name], name));
  byId(id).addEventListener("change", draw);
}
offer("error", data.errors);
offer("cost", data.costs);
byId("met").addEventListener("change", draw);
for (const name of data.filters) {
  const values = [...new Set(data.rows.map((r) => r[name]))].sort((a, b) => (a > b) - (a < b));
  if (values.length < 2) continue;
  const set = document.createElement("fieldset");
  set.appendChild(document.createElement("legend")).textContent = name;
  off[name] = new Set();
  for (const value of values) {
    const label = document.createElement("label"), check = document.createElement("input");
    check.type = "checkbox";
    check.checked = true;
    check.addEventListener("change", () => { off[name][check.checked ? "delete" : "add"](value); draw(); });
    label.append(check, ` ${String(value).replaceAll("_", " ")}`);
    set.appendChild(label);
  }
  byId("filters").appendChild(set);
}
function ticks(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
    for (const m of [1, 2, 5]) {
      const value = m * 10 ** power;
      if (value >= low && value <= high) found.push(value);
    }
  return found;
}
function say(row, event) {
  const lines = [row.label, `${row.mode_count} modes, ${row.frame_count} frames`];
  for (const [axes, scale] of [[data.errors, 1], [data.costs, 1]])
    for (const name in axes) lines.push(`${axes[name]}: ${short(row[name])}`);
  if (row.static_at) lines.push(`worst static: ${row.static_at}`);
  if (row.transient_at) lines.push(`worst over time: ${row.transient_at}`);
  lines.push(`rounds a step: ${short(row.iterations)}`);
  tip.textContent = lines.join("\\n");
  tip.style.display = "block";
  tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8)}px`;
  tip.style.top = `${Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8)}px`;
}
function draw() {
  const error = byId("error").value, cost = byId("cost").value;
  const amount = (value) => error === "share" ? short(value) : `${short(100 * value)} %`;
  svg.replaceChildren();
  const rows = data.rows.filter((r) => r[error] > 0 && r[cost] > 0 && (!byId("met").checked || within(r))
    && Object.entries(off).every(([name, hidden]) => !hidden.has(r[name])));
  byId("front").replaceChildren();
  if (!rows.length) { make("text", { x: 90, y: 60 }, "nothing left to show"); return; }
  const range = (name) => {
    const values = rows.map((r) => r[name]), low = Math.min(...values), high = Math.max(...values);
    const margin = Math.max((high / low) ** 0.06, 1.05);
    return [low / margin, high * margin];
  };
  const [x0, x1] = range(cost), [y0, y1] = range(error);
  const inner = { w: box.width - box.left - box.right, h: box.height - box.top - box.bottom };
  const x = (v) => box.left + (inner.w * Math.log(v / x0)) / Math.log(x1 / x0);
  const y = (v) => box.top + inner.h - (inner.h * Math.log(v / y0)) / Math.log(y1 / y0);
  for (const v of ticks(x0, x1)) {
    make("line", { x1: x(v), x2: x(v), y1: box.top, y2: box.top + inner.h, class: "grid" });
    make("text", { x: x(v), y: box.top + inner.h + 16, "text-anchor": "middle" }, short(v));
  }
  for (const v of ticks(y0, y1)) {
    make("line", { x1: box.left, x2: box.left + inner.w, y1: y(v), y2: y(v), class: "grid" });
    make("text", { x: box.left - 6, y: y(v) + 4, "text-anchor": "end" }, amount(v));
  }
  make("text", { x: box.left + inner.w / 2, y: box.height - 10, "text-anchor": "middle" }, data.costs[cost]);
  const upright = `translate(16 ${box.top + inner.h / 2}) rotate(-90)`;
  make("text", { x: 0, y: 0, "text-anchor": "middle", transform: upright }, data.errors[error]);
  const front = [];
  for (const row of [...rows].sort((a, b) => a[cost] - b[cost] || a[error] - b[error]))
    if (!front.length || row[error] < 0.9 * front[front.length - 1][error]) front.push(row);
  let path = "";
  front.forEach((row, k) => { path += k ? `H${x(row[cost])}V${y(row[error])}` : `M${x(row[cost])} ${y(row[error])}`; });
  make("path", { d: path, class: "front" });
  for (const row of rows) {
    const hollow = row.loads === "reference" && row.kinematics !== "linear", c = colour(row);
    const size = 3 + 1.2 * Math.log10(row.mode_count + 1), opacity = within(row) ? 0.95 : 0.35;
    const place = { cx: x(row[cost]), cy: y(row[error]), r: size, stroke: c, fill: hollow ? "#fff" : c, opacity };
    const dot = make("circle", place);
    dot.addEventListener("mousemove", (event) => say(row, event));
    dot.addEventListener("mouseleave", () => { tip.style.display = "none"; });
  }
  const table = document.createElement("table"), head = table.insertRow();
  for (const words of ["on the front", data.costs[cost], data.errors[error], "within tolerance"])
    head.appendChild(document.createElement("th")).textContent = words;
  front.forEach((row, k) => {
    make("text", { x: x(row[cost]) - 6, y: y(row[error]) + 15, "text-anchor": "end" }, k + 1);
    const line = table.insertRow();
    for (const words of [`${k + 1}  ${row.label}`, short(row[cost]), amount(row[error]), within(row) ? "yes" : "no"])
      line.insertCell().textContent = words;
  });
  byId("front").appendChild(table);
}
draw();
</script>
</body>
</html>
"""
