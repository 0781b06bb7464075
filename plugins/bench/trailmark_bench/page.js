"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const STATES = ["ok", "failed", "timeout", "crashed", "skipped", "running", "pending"];
const PAGE = 200;

const node = (tag, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};

// Three digits, as everywhere in Trailmark.
const number = (value) => {
  if (value === null || value === undefined || Number.isNaN(value)) return "\u2013";
  if (value === "failed") return value;
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  if (magnitude < -4) return value.toExponential(1);
  return value.toFixed(Math.max(0, 2 - magnitude));
};
const duration = (s) => (s === null ? "\u2013" : s < 120 ? `${number(s)} s` : `${number(s / 60)} min`);
const pText = (p) => (p === null || p === undefined ? "\u2013" : p < 1e-4 ? "<0.0001" : p.toPrecision(2).replace(/\.?0+$/, ""));

const places = new Map(data.conditions.map((condition, index) => [condition, index]));
data.entries.sort((a, b) => places.get(a.condition) - places.get(b.condition));  // a method may have come later, for all conditions

let metric = 0;
const filters = { text: "", states: new Set(), method: null, condition: null };

// --- sortable tables ---------------------------------------------------------------------------------------------

// Numbers by size, words by the alphabet; what is not known stands at the end, whichever way.
const compare = (a, b) => (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true }));
const rank = (value) => (value === null || value === undefined ? 2 : value === "failed" ? 1 : 0);

const kindOf = (column) => (column.number ? "number" : column.kind || "");

class SortedTable {
  constructor(table, columns, rows, render, limit = Infinity, more = null) {
    Object.assign(this, { table, columns, rows, render, limit, more, sort: null, shown: limit });
    const head = node("tr");
    columns.forEach((column, index) => {
      const cell = node("th", { scope: "col", className: kindOf(column), tabIndex: 0 }, node("b", { textContent: column.title }));
      cell.dataset.sort = index;
      cell.title = data.meanings[column.title] || "";
      if (column.unit !== undefined) cell.append(node("span", { textContent: column.unit || "\u00a0" }));
      const toggle = () => this.sortBy(index);
      cell.addEventListener("click", toggle);
      cell.addEventListener("keydown", (event) => { if (event.key === "Enter") toggle(); });
      head.append(cell);
    });
    table.replaceChildren(node("thead", {}, head), node("tbody"));
    if (more) more.onclick = () => { this.shown += limit; this.draw(); };
    this.draw();
  }
  sortBy(index) {
    const down = this.sort && this.sort.index === index && !this.sort.down;
    this.sort = { index, down };
    this.table.querySelectorAll("th[data-sort]").forEach((cell, place) => {
      if (place === index) cell.setAttribute("aria-sort", down ? "descending" : "ascending");
      else cell.removeAttribute("aria-sort");
    });
    this.draw();
  }
  show(rows) { this.rows = rows; this.shown = this.limit; this.draw(); }
  draw() {
    let rows = this.rows;
    if (this.sort) {
      const { index, down } = this.sort, value = this.columns[index].value;
      rows = rows.map((row) => [value(row), row]).sort(([a], [b]) => rank(a) - rank(b) || (down ? -1 : 1) * compare(a, b)).map((pair) => pair[1]);
    }
    this.table.tBodies[0].replaceChildren(...rows.slice(0, this.shown).map(this.render));
    if (this.more) {
      this.more.hidden = rows.length <= this.shown;
      this.more.textContent = `${rows.length - this.shown} more`;
    }
  }
}

const renderer = (columns) => (row) => {
  const line = node("tr");
  columns.forEach((column) => {
    const text = column.text ? column.text(row) : number(column.value(row));
    const cell = node(column.number ? "td" : "th", { className: kindOf(column) });
    if (!column.number) cell.scope = "row";
    cell.append(text);
    line.append(cell);
  });
  return line;
};

// --- overview ----------------------------------------------------------------------------------------------------

const statistics = (entry) => entry.stats[metric];
const median = (entry) => { const found = statistics(entry); return found ? found.median : null; };
const column = (title, value, more = {}) => ({ title, value, number: true, ...more });

function drawHeat() {
  const shown = data.metrics[metric], byPlace = new Map(data.entries.map((entry) => [`${entry.method}\n${entry.condition}`, entry]));
  const measured = new Set(data.entries.filter((entry) => statistics(entry) || entry.skipped).map((entry) => entry.condition));
  const part = partsOf.get($("part").value);
  const conditions = data.conditions.filter((condition) => measured.has(condition) && (!part || part.has(condition)));
  const shownMethods = data.methods.filter((method) => conditions.some((condition) => byPlace.has(`${method}\n${condition}`)));
  const head = node("tr", {}, node("th"), ...conditions.map((name) => node("th", { scope: "col", textContent: name.replaceAll("_", "_\u200b") })));  // may break there
  const best = bestOfEach();
  const body = shownMethods.map((method) => {
    const cells = conditions.map((condition) => heatCell(byPlace.get(`${method}\n${condition}`), best.get(condition)));
    return node("tr", {}, node("th", { scope: "row", textContent: method }), ...cells);
  });
  $("heat").replaceChildren(node("thead", {}, head), node("tbody", {}, ...body));
  $("heat-note").textContent = `Median ${shown.title}${shown.unit ? ` [${shown.unit}]` : ""} over places and seeds; ${shown.better} is better. `
    + "The stronger the colour, the further from the best of its column; framed is the best. In red: cells that failed, each counted as the worst result.";
}

// Conditions of each matrix: one of them at a time is narrow enough to be looked at.
const partsOf = new Map();
function makeParts() {
  data.cells.forEach((cell) => { if (!partsOf.has(cell.matrix)) partsOf.set(cell.matrix, new Set()); partsOf.get(cell.matrix).add(cell.condition); });
  $("part").append(...[...partsOf.keys()].map((name) => node("option", { value: name, textContent: name || "all" })));
  if (partsOf.size > 1) $("part").append(node("option", { value: "\u0000", textContent: "all" }));
  $("part-label").hidden = partsOf.size < 2;
  $("part").onchange = drawHeat;
}

const badness = (value) => {
  const better = data.metrics[metric].better;
  return better === "higher" ? -value : better === "near one" ? Math.abs(Math.log(value)) : value;
};
function bestOfEach() {
  const best = new Map();
  data.entries.forEach((entry) => {
    const value = median(entry), known = best.get(entry.condition);
    if (typeof value === "number" && (known === undefined || badness(value) < badness(known))) best.set(entry.condition, value);
  });
  return best;
}
function heatCell(entry, best) {
  const value = entry ? median(entry) : null, failed = entry ? entry.failed : 0;
  const cell = node("td", { textContent: entry && !statistics(entry) && entry.skipped ? "skipped" : number(value) });
  if (!entry || value === null) cell.className = "none";
  else if (value === "failed") cell.className = "lost";
  else {
    if (value === best) cell.className = "best";
    const apart = data.metrics[metric].better === "lower" && best > 0 && value > 0 ? Math.log10(value / best) / 2 : Math.abs(badness(value) - badness(best));
    cell.style.setProperty("--share", `${Math.round(Math.min(1, apart) * 60)}%`);
  }
  if (failed) cell.append(node("small", { textContent: `${failed} of ${failed + entry.ok} failed` }));
  if (entry) cell.onclick = () => { Object.assign(filters, { method: entry.method, condition: entry.condition }); drawCells(); $("cells-section").scrollIntoView(); };
  return cell;
}

let table = null;
function drawStatistics() {
  const unit = data.metrics[metric].unit, of = (key) => (entry) => { const s = statistics(entry); return s ? s[key] : null; };
  const versus = (key) => (entry) => { const s = statistics(entry); return s && s.versus ? s.versus[key] : null; };
  const range = (a, b) => (entry) => { const s = statistics(entry); return !s || s[a] === null ? "\u2013" : `${number(s[a])} \u2013 ${s[b] === null ? "failed" : number(s[b])}`; };
  const columns = [
    { title: "condition", value: (e) => e.condition, text: (e) => e.condition, unit: "" },
    { title: "method", value: (e) => e.method, text: (e) => e.method, unit: "" },
    column("ok", (e) => e.ok, { text: (e) => `${e.ok}/${e.ok + e.failed}`, unit: "" }),
    column("median", of("median"), { unit }),
    column("quartiles", of("q1"), { text: range("q1", "q3"), unit }),
    column("95 % of median", of("low"), { text: range("low", "high"), unit }),
  ];
  if (data.baseline) columns.push(
    column("times baseline", versus("ratio"), { unit: "" }),
    column("better/worse", versus("wins"), { text: (e) => (versus("n")(e) === null ? "\u2013" : `${versus("wins")(e)}/${versus("losses")(e)}`), unit: "" }),
    column("p", versus("p"), { text: (e) => pText(versus("p")(e)), unit: "" }),
    column("p Holm", versus("p_holm"), { text: (e) => pText(versus("p_holm")(e)), unit: "" }),
  );
  table = new SortedTable($("statistics"), columns, data.entries, renderer(columns), PAGE, $("more-statistics"));
}

// --- cells -------------------------------------------------------------------------------------------------------

const label = (cell) => [cell.matrix, ...data.axes.map((axis, index) => (cell.at[index] === null ? null : axis === "seed" ? `seed ${cell.at[index]}` : cell.at[index]))].filter((word) => word !== null && word !== "").join(", ");
const stateOf = (cell) => node("span", {}, node("span", { className: `state ${cell.state}` }, node("i"), cell.state));
// What a narrow screen shows in place of the columns of axes and of the reason.
const stateAndWhy = (cell) => node("span", {}, stateOf(cell), node("small", { className: "why", textContent: [label(cell), cell.reason].filter(Boolean).join(": ") }));
let cellTable = null;
function cellColumns() {
  const shown = data.metrics[metric];
  return [
    { title: "state", value: (c) => STATES.indexOf(c.state), text: stateAndWhy },
    ...data.axes.map((axis, index) => ({ title: axis, kind: "axis", value: (c) => c.at[index], text: (c) => String(c.at[index] ?? "\u2013") })),
    column(`${shown.title}${shown.unit ? ` [${shown.unit}]` : ""}`, (c) => c.values[metric]),
    column("time [s]", (c) => c.cpu_s),
    column("memory [MB]", (c) => c.peak_rss_mb),
    { title: "reason", value: (c) => c.reason || null, text: (c) => c.reason },
  ];
}
function drawCells() {
  const words = filters.text.toLowerCase().split(/\s+/).filter(Boolean);
  const kept = data.cells.filter((cell) => (!filters.states.size || filters.states.has(cell.state))
    && (filters.method === null || cell.method === filters.method) && (filters.condition === null || cell.condition === filters.condition)
    && words.every((word) => cell.search.includes(word)));
  cellTable.show(kept);
  const chosen = [filters.method, filters.condition].filter(Boolean).join(", ");
  $("count").textContent = `${kept.length} of ${data.cells.length}`;
  $("chosen").hidden = !chosen;
  $("chosen").textContent = `${chosen} \u2715`;
}
function makeCells() {
  data.cells.forEach((cell) => { cell.search = `${cell.id} ${label(cell)} ${cell.state} ${cell.reason}`.toLowerCase(); });
  const columns = cellColumns(), row = renderer(columns);
  const render = (cell) => {
    const line = row(cell);
    line.lastChild.className = "reason";
    line.tabIndex = 0;
    line.onclick = () => { location.hash = `cell=${cell.id}`; };
    line.onkeydown = (event) => { if (event.key === "Enter") line.onclick(); };
    return line;
  };
  cellTable = new SortedTable($("cells"), columns, data.cells, render, PAGE, $("more-cells"));
  drawCells();
}
function makeFilters() {
  $("filter").oninput = (event) => { filters.text = event.target.value; drawCells(); };
  $("chosen").onclick = () => { Object.assign(filters, { method: null, condition: null }); drawCells(); };
  const counts = {};
  data.cells.forEach((cell) => { counts[cell.state] = (counts[cell.state] || 0) + 1; });
  STATES.filter((state) => counts[state]).forEach((state) => {
    const chip = node("button", { className: `chip ${state}` }, node("i"), `${counts[state]} ${state}`);
    chip.setAttribute("aria-pressed", "false");
    chip.onclick = () => {
      const on = !filters.states.has(state);
      filters.states[on ? "add" : "delete"](state);
      chip.setAttribute("aria-pressed", String(on));
      drawCells();
    };
    $("states").append(node("li", {}, chip));
  });
}

// --- one cell ----------------------------------------------------------------------------------------------------

async function detailOf(cell) {
  const holder = $(`chunk-${cell.chunk}`);
  if (!holder) return null;
  const line = holder.textContent.split("\n").find((text) => text.startsWith(cell.id));
  const [detail, stderr] = await Promise.all(line.split(" ").slice(1).map(unpacked));
  return { ...detail, stderr };
}
async function unpacked(text) {
  if (!text) return null;
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return JSON.parse(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).text());
}

const SVG = "http://www.w3.org/2000/svg";
const shape = (tag, attributes, text) => {
  const made = document.createElementNS(SVG, tag);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  if (text !== undefined) made.textContent = text;
  return made;
};
const ticks = (low, high) => {
  const raw = (high - low) / 4 || 1, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(Math.abs(at) < 1e-9 * step ? 0 : at);
  return found;
};

// `span`: points that the axes hold in place of those of the lines, so that several plots have one scale.
function plot(title, caption, lines, { equal = false, zero = false, x = "", y = "", width = 460, span = null } = {}) {
  let height = width / 2;
  const left = 52, right = 10, top = 16, bottom = 34;
  const all = span || lines.flatMap((line) => line.points);
  let [x0, x1] = [Math.min(...all.map((p) => p[0])), Math.max(...all.map((p) => p[0]))];
  let [y0, y1] = [Math.min(...all.map((p) => p[1]), zero ? 0 : Infinity), Math.max(...all.map((p) => p[1]), zero ? 0 : -Infinity)];
  if (x1 - x0 < 1e-12) { x0 -= 0.5; x1 += 0.5; }
  if (y1 - y0 < 1e-12) { y0 -= 0.5; y1 += 0.5; }
  if (equal) {
    height = Math.min(400, Math.max(170, (y1 - y0) / (x1 - x0) * (width - left - right) * 1.1 + top + bottom));
    const scale = Math.max((x1 - x0) / (width - left - right), (y1 - y0) / (height - top - bottom)) * 1.04;
    const [cx, cy] = [(x0 + x1) / 2, (y0 + y1) / 2], [w, h] = [scale * (width - left - right) / 2, scale * (height - top - bottom) / 2];
    [x0, x1, y0, y1] = [cx - w, cx + w, cy - h, cy + h];
  }
  const px = (v) => left + (v - x0) / (x1 - x0) * (width - left - right), py = (v) => height - bottom - (v - y0) / (y1 - y0) * (height - top - bottom);
  const svg = shape("svg", { viewBox: `0 0 ${width} ${height}`, class: "plot", role: "img", "aria-label": `${title}: ${caption}` });
  ticks(x0, x1).forEach((v) => svg.append(shape("line", { class: "grid", x1: px(v), x2: px(v), y1: top, y2: height - bottom }), shape("text", { x: px(v), y: height - bottom + 14, "text-anchor": "middle" }, String(+v.toPrecision(6)))));
  ticks(y0, y1).forEach((v) => svg.append(shape("line", { class: "grid", x1: left, x2: width - right, y1: py(v), y2: py(v) }), shape("text", { x: left - 6, y: py(v) + 4, "text-anchor": "end" }, String(+v.toPrecision(6)))));
  svg.append(shape("text", { x: width - right, y: height - 4, "text-anchor": "end" }, x), shape("text", { x: 2, y: 11 }, y));
  lines.forEach((line) => svg.append(shape("path", { class: "line", style: `stroke:${line.colour};stroke-width:${line.width || 1.6}`, d: line.points.map((p, i) => `${i ? "L" : "M"}${px(p[0]).toFixed(1)} ${py(p[1]).toFixed(1)}`).join("") })));
  const legend = node("div", { className: "legend" });
  if (lines.length > 1) lines.forEach((line) => { const mark = node("i"); mark.style.setProperty("--line", line.colour); legend.append(node("span", {}, mark, line.name)); });
  return node("figure", {}, node("figcaption", { textContent: title }, node("span", { textContent: caption })), legend, svg);
}

const placed = (ways, points) => points.map((p) => [ways.low[0] + ways.step * p[0], ways.low[1] + ways.step * p[1]]);
function plotsOf(detail) {
  const found = [], ways = detail.ways || {}, errors = detail.errors;
  if (ways.lines) {
    let series = 0;
    const lines = Object.entries(ways.lines).map(([name, points]) => ({
      name, colour: name === "groundtruth" ? "var(--truth)" : name === "fused" ? "var(--ink)" : `var(--series-${series++ % 6})`, width: name === "groundtruth" ? 4 : 1.5,
      points: placed(ways, points),
    }));
    found.push(plot("Trajectories", ways.lines.groundtruth ? "over ground truth, aligned" : "in the map", lines, { equal: true, x: "x [m]", y: "y [m]" }));
  }
  if (errors) {
    const over = (key) => [{ name: key, colour: "var(--series-0)", points: errors.way_m.map((way, i) => [way, errors[key][i]]) }];
    found.push(plot("Position error", "distance from the true position", over("distance_mm"), { zero: true, x: "way [m]", y: "mm" }));
    found.push(plot("Lateral offset", "across the true heading; left is positive", over("lateral_mm"), { zero: true, x: "way [m]", y: "mm" }));
    found.push(plot("Heading error", "turn from the true heading", over("turn_deg"), { zero: true, x: "way [m]", y: "\u00b0" }));
  }
  return node("div", { className: "plots" }, ...found);
}

// --- methods side by side ------------------------------------------------------------------------------------------

const MOST_BESIDE = 12;
// The cells of a condition at one seed, a method each: the seed at which the most methods have a result.
function cellsBeside(condition) {
  const seed = data.axes.indexOf("seed"), groups = new Map();
  data.cells.filter((cell) => cell.condition === condition).forEach((cell) => {
    const key = seed < 0 ? null : cell.at[seed];
    if (!groups.has(key)) groups.set(key, new Map());
    if (!groups.get(key).has(cell.method)) groups.get(key).set(cell.method, cell);
  });
  const isPictured = (cell) => cell.chunk !== null;  // a large page has pictures of one seed and place alone
  const PICTURED = 1000;  // one picture counts more than all results without: methods are fewer
  const worth = (group) => [...group.values()].reduce((sum, cell) => sum + (cell.state === "ok") * (isPictured(cell) ? PICTURED : 1), 0);
  const [key, group] = [...groups].reduce((best, one) => (worth(one[1]) > worth(best[1]) ? one : best));
  return { seed: key, cells: data.methods.map((method) => group.get(method)).filter(Boolean) };
}
const colourBeside = (index) => `var(--series-${index % 6})`;
function wayLines(ways, colour) {
  const names = Object.keys(ways.lines), own = names.find((name) => name !== "groundtruth");
  const line = (name, stroke, width) => ({ name, colour: stroke, width, points: placed(ways, ways.lines[name]) });
  return [...(ways.lines.groundtruth ? [line("groundtruth", "var(--truth)", 5)] : []), ...(own ? [line(own, colour, 1.6)] : [])];
}
async function drawBeside() {
  const condition = $("beside-condition").value, { seed, cells } = cellsBeside(condition), shown = data.metrics[metric];
  const details = await Promise.all(cells.slice(0, MOST_BESIDE).map((cell) => detailOf(cell)));
  if ($("beside-condition").value !== condition || shown !== data.metrics[metric]) return;  // another was chosen meanwhile
  const lines = details.map((detail, index) => (detail && detail.ways && detail.ways.lines ? wayLines(detail.ways, colourBeside(index)) : []));
  const span = lines.flat().flatMap((line) => line.points);
  const figures = lines.map((drawn, index) => {
    const cell = cells[index], value = cell.values[metric];
    const caption = cell.state === "ok" ? `${shown.title} ${number(value)} ${shown.unit}` : `${cell.state}: ${cell.reason}`;
    const figure = drawn.length ? plot(cell.method, caption, drawn, { equal: true, x: "x [m]", y: "y [m]", width: 320, span })
      : node("figure", {}, node("figcaption", { textContent: cell.method }, node("span", { textContent: caption })));
    figure.querySelector(".legend")?.remove();
    const link = node("a", { href: `#cell=${cell.id}` }, figure);
    link.setAttribute("aria-label", `${cell.method}: ${caption}`);
    return link;
  });
  const errors = details.flatMap((detail, index) => (detail && detail.errors
    ? [{ name: cells[index].method, colour: colourBeside(index), points: detail.errors.way_m.map((way, i) => [way, detail.errors.distance_mm[i]]) }] : []));
  const truth = lines.some((drawn) => drawn.length > 1), beyond = cells.length - MOST_BESIDE;
  $("beside").replaceChildren(...figures);
  $("beside-errors").replaceChildren(...(errors.length ? [plot("Position error", "distance from the true position", errors, { zero: true, x: "way [m]", y: "mm" })] : []));
  $("beside-note").textContent = `${condition ? `${condition}. ` : ""}${truth ? "In colour the answers, over the ground truth in grey, aligned as their errors are; one" : "One"} scale for all${seed === null ? "" : `, seed ${seed}`}.`
    + (beyond > 0 ? ` ${beyond} more methods stand among the cells.` : "");
}
// Medians and their 95 % intervals of the methods under a condition, the best first; a failure stands in words.
function drawRanking() {
  const condition = $("beside-condition").value, shown = data.metrics[metric];
  const rows = data.entries.filter((entry) => entry.condition === condition && median(entry) !== null)
    .sort((a, b) => rank(median(a)) - rank(median(b)) || badness(median(a)) - badness(median(b)));
  const values = rows.flatMap((entry) => ["median", "low", "high"].map((key) => statistics(entry)[key])).filter((v) => typeof v === "number");
  if (rows.length < 2 || !values.length) { $("ranking").replaceChildren(); return; }
  const logarithmic = Math.min(...values) > 0 && Math.max(...values) > 10 * Math.min(...values), scale = logarithmic ? Math.log10 : (v) => v;
  let [x0, x1] = [Math.min(...values.map(scale)), Math.max(...values.map(scale))];
  if (x1 - x0 < 1e-12) { x0 -= 0.5; x1 += 0.5; }
  const longest = Math.max(...rows.map((entry) => entry.method.length)), width = Math.min(640, Math.max(340, $("ranking").clientWidth || 640));
  const left = Math.min(width / 2, 24 + 6.5 * longest), letters = Math.floor((left - 24) / 6.5), right = 60, line = 22, height = line * rows.length + 34;
  const px = (v) => left + (scale(v) - x0) / (x1 - x0) * (width - left - right);
  const svg = shape("svg", { viewBox: `0 0 ${width} ${height}`, class: "plot", role: "img", "aria-label": `${shown.title} of each method under ${condition}` });
  const marks = logarithmic ? ticks(x0, x1).filter(Number.isInteger).map((v) => 10 ** v) : ticks(x0, x1);
  marks.forEach((v) => svg.append(shape("line", { class: "grid", x1: px(v), x2: px(v), y1: 4, y2: height - 30 }), shape("text", { x: px(v), y: height - 16, "text-anchor": "middle" }, String(+v.toPrecision(6)))));
  rows.forEach((entry, index) => {
    const y = 16 + line * index, found = statistics(entry), value = found.median;
    const name = shape("text", { x: left - 10, y: y + 4, "text-anchor": "end" }, entry.method.length > letters ? `${entry.method.slice(0, letters - 1)}\u2026` : entry.method);
    name.append(shape("title", {}, entry.method));
    svg.append(name);
    if (typeof value !== "number") { svg.append(shape("text", { x: left, y: y + 4, class: "failed-word" }, value)); return; }
    if (found.low !== null && found.high !== null) svg.append(shape("line", { class: "interval", x1: px(found.low), x2: px(found.high), y1: y, y2: y }));
    svg.append(shape("circle", { class: "median", cx: px(value), cy: y, r: 4.5 }), shape("text", { x: Math.max(px(value), px(found.high ?? value)) + 9, y: y + 4 }, number(value)));
  });
  const title = `${shown.title}${shown.unit ? ` [${shown.unit}]` : ""}`;
  const caption = `median and its 95 % interval${logarithmic ? ", on a logarithmic scale" : ""}; ${shown.better} is better`;
  $("ranking").replaceChildren(node("figure", {}, node("figcaption", { textContent: title }, node("span", { textContent: caption })), svg));
}
function makeBeside() {
  const withResult = data.conditions.filter((condition) => data.cells.some((cell) => cell.condition === condition && cell.state === "ok" && typeof cell.chunk === "number"));
  $("beside-section").hidden = !withResult.length;
  withResult.forEach((condition) => $("beside-condition").append(node("option", { value: condition, textContent: condition || "all" })));
  $("beside-condition").onchange = () => { drawRanking(); drawBeside(); };
}

const section = (title, ...content) => [node("h2", { textContent: title }), ...content];
const plainTable = (head, rows) => {
  const made = node("table", {}, node("thead", {}, node("tr", {}, ...head.map((text, i) => node("th", { scope: "col", className: i ? "number" : "", textContent: text })))));
  made.append(node("tbody", {}, ...rows.map((row) => node("tr", {}, ...row.map((text, i) => node(i ? "td" : "th", { className: i ? "number" : "", textContent: text }))))));
  return node("div", { className: "scroll" }, made);
};
const facts = (value) => {
  if (value === null || typeof value !== "object") return String(value ?? "none");
  const list = node("dl");
  Object.entries(value).forEach(([key, item]) => { const told = node("dd"); told.append(facts(item)); list.append(node("dt", { textContent: key }), told); });
  return list;
};

async function showCell(id) {
  const cell = data.cells.find((one) => one.id === id), page = $("cell");
  if (!cell) { location.hash = ""; return; }
  const back = node("a", { href: "#", className: "back", textContent: "\u2190 all cells" });
  const why = cell.reason ? `: ${cell.reason}` : "";
  page.replaceChildren(back, node("h1", { textContent: label(cell) }), node("p", { className: "summary" }, stateOf(cell), why));
  $("bench").hidden = true;
  page.hidden = false;
  scrollTo(0, 0);
  const figures = data.metrics.map((shown, i) => [`${shown.title}${shown.unit ? ` [${shown.unit}]` : ""}`, number(cell.values[i])]);
  const ran = [["attempts", String(cell.attempts)], ["wall time", duration(cell.wall_s)], ["processor time", duration(cell.cpu_s)], ["peak memory", `${number(cell.peak_rss_mb)} MB`], ["load at the start", number(cell.load)], ["machine", cell.host ?? "\u2013"], ["address", cell.id]];
  page.append(...section("Figures", plainTable(["", "value"], [...figures, ...ran])));
  const detail = await detailOf(cell);
  if (location.hash !== `#cell=${id}` || !detail) return;
  if (detail.ways) page.insertBefore(plotsOf(detail), page.children[3]);
  if (detail.stages && Object.keys(detail.stages).length) page.append(...section("Latency of a call", plainTable(["stage", "median [ms]", "95 %", "99 %", "max"], Object.entries(detail.stages).map(([name, row]) => [name, ...row.map(number)]))));
  const told = Object.entries(detail.sources || {}).flatMap(([name, item]) => ["nis", "nees"].filter((word) => item[word]).map((word) => [`${name}, ${word.toUpperCase()}`, number(item[word].per_dof), `${number(item[word].lower)} \u2013 ${number(item[word].upper)}`, String(item[word].n), item[word].verdict]));
  if (told.length) page.append(...section("Consistency", plainTable(["squared error per degree of freedom", "found", "expected", "of", ""], told)));
  if (detail.config) page.append(...section("Configuration", node("pre", {}, node("code", { textContent: detail.config }))));
  if (detail.provenance) page.append(...section("Provenance", facts(detail.provenance)));
  if (detail.stderr) page.append(...section("End of the log", node("pre", {}, node("code", { textContent: detail.stderr }))));
}

function route() {
  const wanted = location.hash.match(/^#cell=(\w+)$/);
  if (wanted) { showCell(wanted[1]); return; }
  $("cell").hidden = true;
  $("bench").hidden = false;
}

function drawMetric() { drawHeat(); drawStatistics(); makeCells(); if (!$("beside-section").hidden) { drawRanking(); drawBeside(); } }
data.metrics.forEach((shown, index) => $("metric").append(node("option", { value: index, textContent: shown.title })));
$("metric").onchange = (event) => { metric = Number(event.target.value); drawMetric(); };
makeFilters();
makeParts();
makeBeside();
drawMetric();
addEventListener("hashchange", route);
route();
document.documentElement.dataset.ready = "true";
