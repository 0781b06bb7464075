"use strict";
// The map of a run and its time axis. Names are text, never markup. All that is drawn comes from the page itself, or, of a
// run that goes on, from the page's own script: it calls showDocument again and again.
const $ = (id) => document.getElementById(id);
const OUTCOMES = ["accepted", "gated", "late", "refused", "lost", "unused"];
const ERRORS = ["distance", "ahead", "left", "turn"];

const node = (tag, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};
const svg = (tag, attributes = {}, ...children) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
  made.append(...children);
  return made;
};
const unpack = (column) => {
  const [steps, ...rest] = column;
  let sum = 0;
  return Float64Array.from(rest, (step) => (step === null ? NaN : (sum += step) / steps));
};
const number = (value) => {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size === 0 ? "0" : size < 1e-3 ? value.toExponential(1) : value.toFixed(Math.max(0, Math.min(4, 2 - Math.floor(Math.log10(size))))).replace("-", "−");
};
const hypot = (xs, ys) => xs.map((x, i) => Math.hypot(x, ys[i]));
const degrees = (values) => values.map((value) => (value * 180) / Math.PI);
// The index of the last stamp that is not after a time.
const before = (stamps, time) => {
  let low = 0, high = stamps.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (stamps[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
};

// --- what there is -----------------------------------------------------------------------------------------------

const read = (item) => {
  const found = { ...item };
  ["t", "x", "y", "h", "ahead", "left", "turn", "long", "short", "axis"].forEach((key) => { if (item[key]) found[key] = unpack(item[key]); });
  if (found.ahead) found.distance = hypot(found.ahead, found.left);
  return found;
};
let data, WORD, tracks, fixes, beliefs, offsets, byName, compared, fused, QUANTITIES;
let pictures = [...document.querySelectorAll(".glimpses img")].map((image) => ({ sensor: image.dataset.sensor, t: Number(image.dataset.time), src: image.src, alt: image.alt }));
function take(told) {
  data = told;
  WORD = data.errors ? "error" : "difference";
  [tracks, fixes, beliefs] = [data.tracks.map(read), data.fixes.map(read), data.beliefs ? read(data.beliefs) : null];
  offsets = Object.entries(data.offsets).map(([name, line]) => ({ name, t: unpack(line.t), v: unpack(line.v) }));
  byName = new Map(tracks.map((track) => [track.name, track]));
  compared = tracks.filter((track) => track.distance);
  fused = byName.get("fused") || tracks[tracks.length - 1];
  tracks.forEach(derive);
  QUANTITIES = quantities();
}
function derive(track) {
  let last = -Infinity;
  track.clock = track.t.map((t) => (Number.isNaN(t) ? last : (last = t)));  // a gap has no time of its own
  track.speed = track.t.map((t, i) => {
    const from = Math.max(0, i - 2), to = Math.min(track.t.length - 1, i + 2), dt = track.t[to] - track.t[from];
    return dt > 0 ? Math.hypot(track.x[to] - track.x[from], track.y[to] - track.y[from]) / dt : NaN;
  });
  if (track.distance) {  // the error in the axes of the drawing, to draw it larger than it is
    track.dx = track.h.map((h, i) => Math.cos(h - track.turn[i]) * track.ahead[i] - Math.sin(h - track.turn[i]) * track.left[i]);
    track.dy = track.h.map((h, i) => Math.sin(h - track.turn[i]) * track.ahead[i] + Math.cos(h - track.turn[i]) * track.left[i]);
  }
}

const hidden = new Set();
const shows = (name) => !hidden.has(name);
// The window of time, the cursor, and whether it goes with a run that goes on: until somebody points.
const state = { from: 0, to: 0, at: null, isFollowing: false, times: 1, byError: false, quantity: null, isChosen: false };
const isWhole = () => state.from === 0 && state.to === data.span;

// --- the map -----------------------------------------------------------------------------------------------------

const view = { x: 0, y: 0, scale: 1, width: 1, height: 1, isFitted: true };
const right = (x) => view.width / 2 + (x - view.x) * view.scale;
const down = (y) => view.height / 2 - (y - view.y) * view.scale;

function extent() {
  let west = Infinity, east = -Infinity, south = Infinity, north = -Infinity;
  const take = (x, y) => { if (Number.isFinite(x + y)) { west = Math.min(west, x); east = Math.max(east, x); south = Math.min(south, y); north = Math.max(north, y); } };
  tracks.filter((track) => shows(track.name)).forEach((track) => track.x.forEach((x, i) => { if (isWhole() || (track.t[i] >= state.from && track.t[i] <= state.to)) take(x, track.y[i]); }));
  if (isWhole()) { data.taught.forEach(([x, y]) => take(x, y)); }
  if (!(east >= west)) return [-1, 1, -1, 1];
  const [x0, x1, y0, y1] = [west, east, south, north];
  if (isWhole()) data.around.forEach((line) => line.forEach(([x, y]) => {  // what stands near is seen, a distant wall is not
    if (x > x0 - 3 && x < x1 + 3 && y > y0 - 3 && y < y1 + 3) take(x, y);
  }));
  return [west, east, south, north];
}
function fit() {
  const [west, east, south, north] = extent(), air = 0.06 * Math.max(east - west, north - south, 0.2);
  Object.assign(view, { x: (west + east) / 2, y: (south + north) / 2, isFitted: true });
  view.scale = Math.min(view.width / (east - west + 2 * air), view.height / (north - south + 2 * air));
}
function zoom(factor, px = view.width / 2, py = view.height / 2) {
  const x = view.x + (px - view.width / 2) / view.scale, y = view.y - (py - view.height / 2) / view.scale;
  view.scale = Math.min(1e7, Math.max(1e-3, view.scale * factor));
  view.x = x - (px - view.width / 2) / view.scale;
  view.y = y + (py - view.height / 2) / view.scale;
  view.isFitted = false;
  later();
}

// A path through points of the screen; those that fall together are left out.
function pathOf(xs, ys, from, to) {
  let text = "", isDown = false, lastX = 0, lastY = 0;
  for (let i = from; i < to; i += 1) {
    const x = xs(i), y = ys(i);
    if (!Number.isFinite(x + y)) { isDown = false; continue; }
    if (isDown && Math.abs(x - lastX) + Math.abs(y - lastY) < 0.4) continue;
    text += `${isDown ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
    [isDown, lastX, lastY] = [true, x, y];
  }
  return text;
}
const drawnX = (track, i) => right(track.x[i] + (track.dx ? (state.times - 1) * track.dx[i] : 0));
const drawnY = (track, i) => down(track.y[i] + (track.dy ? (state.times - 1) * track.dy[i] : 0));
const trackPath = (track, from = 0, to = track.t.length) => pathOf((i) => drawnX(track, i), (i) => drawnY(track, i), from, to);
const linePath = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${right(x).toFixed(1)} ${down(y).toFixed(1)}`).join("");
const within = (track) => {
  let from = 0, to = track.t.length;
  while (from < to && !(track.t[from] >= state.from)) from += 1;
  while (to > from && !(track.t[to - 1] <= state.to)) to -= 1;
  return [from, to];
};

const HEAT = ["--heat-0", "--heat-1", "--heat-2", "--heat-3", "--heat-4", "--heat-5"];
function heatScale() {
  const found = compared.filter((track) => shows(track.name)).flatMap((track) => [...track.distance]).filter((value) => value > 0).sort((a, b) => a - b);
  const at = (share) => found[Math.min(found.length - 1, Math.floor(share * found.length))];
  const [low, high] = found.length ? [Math.log(at(0.05)), Math.log(at(0.99))] : [0, 1];
  return { low, high, of: (value) => Math.max(0, Math.min(5, Math.floor((6 * (Math.log(value) - low)) / Math.max(1e-9, high - low)))) };
}

const map = $("map");
function drawMap() {
  const box = map.getBoundingClientRect();
  if (!box.width) return;
  Object.assign(view, { width: box.width, height: box.height });
  if (view.isFitted) fit();
  map.setAttribute("viewBox", `0 0 ${box.width} ${box.height}`);
  const layers = [];
  const add = (tag, attributes, title = "", text = "") => {
    const made = svg(tag, attributes, text);
    if (title) made.append(svg("title", {}, title));
    layers.push(made);
  };
  grid(add);
  if (shows("around")) drawAround(add);
  if (shows("taught path")) add("path", { d: linePath(data.taught), class: "taught" });
  if (shows("blind")) drawGaps(add);
  if (shows("fixes")) drawFixes(add);
  drawTracks(add);
  if (shows("ellipses") && beliefs) drawEllipses(add);
  scaleBar(add);
  if (state.at !== null) drawRobots(add);
  map.replaceChildren(...layers);
}
const round125 = (value) => {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value * 0.999);
};
function grid(add) {
  const step = round125(70 / view.scale), lines = [];
  for (let x = Math.ceil((view.x - view.width / 2 / view.scale) / step); x * step < view.x + view.width / 2 / view.scale; x += 1) lines.push(`M${right(x * step).toFixed(1)} 0V${view.height}`);
  for (let y = Math.ceil((view.y - view.height / 2 / view.scale) / step); y * step < view.y + view.height / 2 / view.scale; y += 1) lines.push(`M0 ${down(y * step).toFixed(1)}H${view.width}`);
  add("path", { d: lines.join(""), class: "grid" });
}
const lengthText = (metres) => (metres >= 1000 ? `${metres / 1000} km` : metres >= 0.999 ? `${Math.round(metres)} m` : metres >= 0.0099 ? `${Math.round(metres * 100)} cm` : metres >= 0.00099 ? `${Math.round(metres * 1000)} mm` : `${Math.round(metres * 1e6)} µm`);
function scaleBar(add) {
  const length = round125(60 / view.scale), y = view.height - 12;
  add("path", { d: `M12 ${y - 5}V${y}H${12 + length * view.scale}V${y - 5}`, class: "scale" });
  add("text", { x: 18, y: y - 6, class: "small" }, "", lengthText(length));
}
function drawAround(add) {
  let lines = "", dots = "";
  data.around.forEach((line) => {
    const xs = line.map(([x]) => right(x)), ys = line.map(([, y]) => down(y)), [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    if (Math.max(x1 - x0, y1 - y0) < 5) dots += `M${((x0 + x1) / 2).toFixed(1)} ${((y0 + y1) / 2).toFixed(1)}h0`;
    else lines += linePath(line);
  });
  add("path", { d: lines, class: "around" });
  add("path", { d: dots, class: "around dot" });
}
function drawTracks(add) {
  const heat = state.byError ? heatScale() : null;
  tracks.filter((track) => shows(track.name)).forEach((track) => {
    const style = { class: "track", "stroke-width": track.width, stroke: `var(${track.colour})`, ...(track.dash ? { "stroke-dasharray": track.dash } : {}) };
    if (!isWhole()) add("path", { ...style, d: trackPath(track), opacity: 0.2 });
    const [from, to] = within(track);
    if (heat && track.distance) {
      const pieces = HEAT.map(() => "");
      for (let i = from; i + 1 < to; i += 1) {
        const piece = pathOf((k) => drawnX(track, k), (k) => drawnY(track, k), i, i + 2);
        if (piece.includes("L")) pieces[heat.of(track.distance[i])] += piece;
      }
      pieces.forEach((d, level) => add("path", { d, class: "track", stroke: `var(${HEAT[level]})`, "stroke-width": 2 + track.width }));
    } else add("path", { ...style, d: trackPath(track, from, to) }, track.name);
    const first = track.t.findIndex((value) => !Number.isNaN(value));
    if (first >= 0) add("circle", { cx: drawnX(track, first), cy: drawnY(track, first), r: 3, fill: `var(${track.colour})` });
  });
}
function drawGaps(add) {
  const shown = byName.get("groundtruth") || fused;
  data.gaps.filter((gap) => shows(gap.name)).forEach((gap) => {
    let from = shown.t.findIndex((t) => t >= gap.from), to = from;
    while (to < shown.t.length && !(shown.t[to] > gap.to)) to += 1;
    if (from > 0) from -= 1;
    const said = gap.kind === "lost" ? `lost: ${gap.reason}` : "said nothing";
    add("path", { d: trackPath(shown, from, to), class: `gap ${gap.kind}` }, `${gap.name} ${said}, ${number(gap.from)} to ${number(gap.to)} s`);
  });
}
function drawFixes(add) {
  fixes.filter((item) => shows(item.name)).forEach((item) => {
    const dots = new Map();
    item.t.forEach((t, i) => {
      const x = right(item.x[i]), y = down(item.y[i]);
      if (t < state.from || t > state.to || x < -5 || y < -5 || x > view.width + 5 || y > view.height + 5) return;
      const word = OUTCOMES[item.outcome[i]];
      dots.set(word, `${dots.get(word) || ""}M${x.toFixed(1)} ${y.toFixed(1)}h0`);
    });
    dots.forEach((d, word) => add("path", { d, class: "fix", stroke: word === "accepted" ? `var(${item.colour})` : `var(--${word})`, "stroke-width": word === "accepted" ? 6 : 8 }, `${item.name}: ${word}`));
  });
}
function ellipsePath(i, times) {
  const cos = Math.cos(beliefs.axis[i]), sin = Math.sin(beliefs.axis[i]);
  const points = [];
  for (let k = 0; k <= 32; k += 1) {
    const a = 3 * times * beliefs.long[i] * Math.cos((k * Math.PI) / 16), b = 3 * times * beliefs.short[i] * Math.sin((k * Math.PI) / 16);
    points.push([beliefs.x[i] + cos * a - sin * b, beliefs.y[i] + sin * a + cos * b]);
  }
  return `${linePath(points)}Z`;
}
function drawEllipses(add) {
  const seen = [...beliefs.t.keys()].filter((i) => {
    const x = right(beliefs.x[i]), y = down(beliefs.y[i]);
    return beliefs.t[i] >= state.from && beliefs.t[i] <= state.to && x > -200 && y > -200 && x < view.width + 200 && y < view.height + 200;
  });
  const step = Math.max(1, Math.ceil(seen.length / 36));
  add("path", { d: seen.filter((_, k) => k % step === 0).map((i) => ellipsePath(i, state.times)).join(""), class: "ellipse" }, `the belief, ±3 σ${state.times > 1 ? `, drawn ${state.times} times as large` : ""}`);
  if (state.at !== null) add("path", { d: ellipsePath(before(beliefs.t, state.at), state.times), class: "ellipse now" });
}
function placeAt(track, time) {
  const i = before(track.clock, time), k = Math.min(i + 1, track.t.length - 1);
  if (!(track.clock[i] <= time)) return null;
  const share = track.t[k] > track.t[i] ? Math.min(1, (time - track.t[i]) / (track.t[k] - track.t[i])) : 0;
  const between = (column) => (Number.isFinite(column[k]) ? column[i] + share * (column[k] - column[i]) : column[i]);
  const found = { i, x: between(track.x), y: between(track.y), h: between(track.h) };
  if (track.dx && state.times > 1) { found.x += (state.times - 1) * between(track.dx); found.y += (state.times - 1) * between(track.dy); }
  return found;
}
function drawRobots(add) {
  const body = data.robot || [[0.15, 0], [-0.1, 0.08], [-0.1, -0.08], [0.15, 0]];
  const long = Math.max(...body.map(([x]) => Math.abs(x))) * view.scale, larger = long < 9 ? 9 / long : 1;
  const outline = (place) => body.map(([bx, by], i) => {
    const [cos, sin] = [Math.cos(place.h), Math.sin(place.h)], [x, y] = [bx * larger, by * larger];
    return `${i ? "L" : "M"}${right(place.x + cos * x - sin * y).toFixed(1)} ${down(place.y + sin * x + cos * y).toFixed(1)}`;
  }).join("");
  const nose = (place) => `M${right(place.x).toFixed(1)} ${down(place.y).toFixed(1)}L${(right(place.x) + Math.cos(place.h) * long * larger).toFixed(1)} ${(down(place.y) - Math.sin(place.h) * long * larger).toFixed(1)}`;
  tracks.filter((track) => shows(track.name)).forEach((track) => {
    const place = placeAt(track, state.at);
    if (!place || !Number.isFinite(place.x)) return;
    if (state.isFollowing && track.clock[track.clock.length - 1] < state.at - 0.5) return;  // it is known only so far
    const isMain = track === fused || track.name === "groundtruth";
    if (isMain) add("path", { d: outline(place) + nose(place), class: long < view.width / 4 ? "robot" : "robot large", stroke: `var(${track.colour})`, "stroke-width": track === fused ? 2 : 3 });
    add("circle", { cx: right(place.x), cy: down(place.y), r: isMain ? 3 : 4, fill: `var(${track.colour})`, class: "place" });
  });
}

// --- the time axis -----------------------------------------------------------------------------------------------

const quantities = () => ({
  distance: { title: `Position ${WORD}`, unit: data.unit, per: data.per_m, about: `How far each was from ${data.reference || "the reference"}. Below the edge of the grey area 989 of 1000 errors should lie: it is three standard deviations, as the estimator states them.` },
  ahead: { title: `${WORD} ahead`, unit: data.unit, per: data.per_m, about: "Along the true heading; ahead is positive. Grey: ±3 σ, as the estimator states it." },
  left: { title: `${WORD} to the left`, unit: data.unit, per: data.per_m, about: "Across the true heading; left is positive. Grey: ±3 σ, as the estimator states it." },
  turn: { title: `Heading ${WORD}`, unit: "°", per: 180 / Math.PI, about: "Counter-clockwise is positive. Grey: ±3 σ, as the estimator states it." },
  offset: { title: "Left of the taught path", unit: data.unit, per: data.per_m, about: "How far beside the path as it is remembered: in truth, and as believed." },
  speed: { title: "Speed", unit: "m/s", per: 1, about: "From the positions, over five points that are drawn." },
  x: { title: "x", unit: "m", per: 1, about: "In the map." },
  y: { title: "y", unit: "m", per: 1, about: "In the map." },
  h: { title: "Heading", unit: "°", per: 180 / Math.PI, about: "Counter-clockwise from x." },
});
const MARGIN = { left: 52, right: 10 };
const axis = $("axis");
const timeX = (t) => MARGIN.left + ((t - state.from) / (state.to - state.from)) * (axisWidth - MARGIN.left - MARGIN.right);
const xTime = (x) => state.from + ((x - MARGIN.left) / (axisWidth - MARGIN.left - MARGIN.right)) * (state.to - state.from);
let axisWidth = 600;

function linesOf(quantity) {
  if (quantity === "offset") return offsets.filter((line) => shows(line.name)).map((line) => ({ ...byName.get(line.name), t: line.t, values: line.v }));
  const has = ERRORS.includes(quantity) ? compared : tracks;
  const main = quantity === "speed" ? has.filter((track) => track === fused || track.name === "groundtruth") : has;
  return main.filter((track) => shows(track.name)).map((track) => ({ ...track, values: track[quantity] }));
}
function bandOf(quantity) {
  if (!beliefs || !ERRORS.includes(quantity) || !shows("fused") || !data.errors) return null;
  return quantity === "distance" ? beliefs.long.map((value, i) => 3 * value) : beliefs[quantity].map((value) => 3 * value);
}
function drawPanel(group, quantity, top, height) {
  const { title, unit, per, about } = QUANTITIES[quantity], lines = linesOf(quantity), band = bandOf(quantity);
  const seen = (t, values) => [...values.keys()].filter((i) => t[i] >= state.from && t[i] <= state.to && Number.isFinite(values[i])).map((i) => per * values[i]);
  const all = lines.map((line) => seen(line.t, line.values)), spread = band ? seen(beliefs.t, band).sort((a, b) => a - b) : [];
  const flat = all.flat(), rms = all.map((values) => Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / values.length)).filter((value) => value > 0);
  const isLogarithmic = quantity === "distance" && rms.length > 1 && Math.max(...rms) > 20 * Math.min(...rms);
  let low, high;
  if (isLogarithmic) {
    [low, high] = [Math.min(...rms) / 10, flat.reduce((a, b) => Math.max(a, b), 0) * 1.3];
  } else if (quantity === "distance") [low, high] = [0, 1.05 * flat.reduce((a, b) => Math.max(a, b), 0)];
  else {
    const wide = spread.length ? spread[Math.floor(0.95 * (spread.length - 1))] : 0;
    const mine = ERRORS.includes(quantity) && shows("fused") && band ? all[lines.findIndex((line) => line.name === "fused")] || flat : flat;
    [low, high] = [mine.reduce((a, b) => Math.min(a, b), Infinity), mine.reduce((a, b) => Math.max(a, b), -Infinity)];
    if (wide) [low, high] = [Math.min(low, -wide), Math.max(high, wide)];
    if (quantity === "speed") low = Math.min(0, low);
    const air = 0.06 * (high - low) || 0.1;
    [low, high] = [low - air, high + air];
  }
  if (!(high > low)) [low, high] = [0, 1];
  const scaled = (value) => (isLogarithmic ? Math.log(Math.max(value, low * 0.5) / low) / Math.log(high / low) : (value - low) / (high - low));
  const y = (value) => top + height - Math.max(-0.5, Math.min(1.5, scaled(value))) * height;
  const heading = svg("text", { x: 0, y: top - 10, class: "panel" }, `${title[0].toUpperCase()}${title.slice(1)} [${unit}]${isLogarithmic ? ", logarithmic" : ""}`);
  heading.append(svg("title", {}, about));
  group.append(heading);
  ticks(low, high, isLogarithmic, height).forEach((value) => {
    group.append(svg("path", { d: `M${MARGIN.left} ${y(value).toFixed(1)}H${axisWidth - MARGIN.right}`, class: value === 0 ? "zero-line" : "grid" }));
    group.append(svg("text", { x: MARGIN.left - 7, y: y(value) + 4, class: "small end" }, tickText(value)));
  });
  const inner = svg("g", { "clip-path": `url(#clip-${group.dataset.name})` });
  group.append(svg("clipPath", { id: `clip-${group.dataset.name}` }, svg("rect", { x: MARGIN.left, y: top, width: axisWidth - MARGIN.left - MARGIN.right, height })), inner);
  if (band) {
    const points = [...beliefs.t.keys()].filter((i) => beliefs.t[i] >= state.from - data.span / 50 && beliefs.t[i] <= state.to + data.span / 50);
    const upper = points.map((i) => `${timeX(beliefs.t[i]).toFixed(1)} ${y(per * band[i]).toFixed(1)}`);
    const floor = quantity === "distance" ? (i) => top + height : (i) => y(-per * band[i]);
    if (points.length) inner.append(svg("path", { d: `M${upper.join("L")}L${points.reverse().map((i) => `${timeX(beliefs.t[i]).toFixed(1)} ${floor(i).toFixed(1)}`).join("L")}Z`, class: "band" }));
  }
  if (ERRORS.includes(quantity) && shows("fixes")) fixes.filter((item) => shows(item.name) && item[quantity]).forEach((item) => {
    const dots = (isGood) => [...item.t.keys()].filter((i) => (item.outcome[i] === 0) === isGood && item.t[i] >= state.from && item.t[i] <= state.to && Number.isFinite(item[quantity][i])).map((i) => `M${timeX(item.t[i]).toFixed(1)} ${y(per * item[quantity][i]).toFixed(1)}h0`).join("");
    inner.append(svg("path", { d: dots(true), class: "fix", stroke: `var(${item.colour})`, "stroke-width": 3 }), svg("path", { d: dots(false), class: "fix", stroke: "var(--gated)", "stroke-width": 4 }));
  });
  lines.forEach((line) => inner.append(svg("path", {
    d: pathOf((i) => timeX(line.t[i]), (i) => y(per * line.values[i]), 0, line.t.length), class: "track", stroke: `var(${line.colour})`, "stroke-width": line.width, ...(line.dash ? { "stroke-dasharray": line.dash } : {}),
  }, svg("title", {}, line.name))));
}
function ticks(low, high, isLogarithmic, height) {
  const found = [];
  if (isLogarithmic) {
    for (let power = Math.ceil(Math.log10(low)); power <= Math.log10(high); power += 1) found.push(10 ** power);
    return found;
  }
  const step = round125((high - low) / Math.max(2, height / 36));
  for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push(k * step);
  return found;
}
const tickText = (value) => String(Number(value.toPrecision(6))).replace("-", "−");

const LANE = 30;
function drawLanes(group, top) {
  data.lanes.forEach((lane, row) => {
    const y = top + LANE * row, label = svg("text", { x: MARGIN.left, y: y - 4, class: "small lane" }, lane.name);
    label.append(svg("title", {}, Object.entries(lane.counts).map(([word, count]) => `${count} ${word}`).join(", ")));
    const shares = OUTCOMES.filter((word) => lane.shares[word]).map((word) => [word, unpack(lane.shares[word])]);
    const inner = svg("g", { "clip-path": "url(#clip-lanes)" });
    const level = new Float64Array(shares.length ? shares[0][1].length : 0);
    shares.forEach(([word, share]) => {
      let d = "";
      share.forEach((value, i) => {
        const from = lane.from + i * lane.step, next = from + lane.step;
        if (!(value > 0) || next < state.from || from > state.to) return;
        const bottom = y + 10 - 10 * level[i];
        d += `M${timeX(from).toFixed(1)} ${bottom.toFixed(1)}H${(timeX(next) + 0.2).toFixed(1)}V${(bottom - 10 * value).toFixed(1)}H${timeX(from).toFixed(1)}Z`;
        level[i] += value;
      });
      inner.append(svg("path", { d, style: `fill: var(--${word})` }, svg("title", {}, `${lane.name}: ${word}`)));
    });
    group.append(inner, label);
  });
}
function drawAxis() {
  axisWidth = Math.max(260, axis.parentElement.clientWidth);
  const isNarrow = axisWidth < 500, main = isNarrow ? 130 : 170, second = 64;
  const lanesTop = 24 + main + 40 + second + 56, bottom = data.lanes.length ? lanesTop + LANE * data.lanes.length - 16 : 24 + main + 40 + second + 4;
  MARGIN.left = 46;
  axis.setAttribute("viewBox", `0 0 ${axisWidth} ${bottom + 26}`);
  axis.style.height = `${bottom + 26}px`;
  const first = svg("g"), speed = svg("g"), rest = svg("g");
  first.dataset.name = "first";
  speed.dataset.name = "second";
  drawPanel(first, state.quantity, 24, main);
  drawPanel(speed, state.quantity === "speed" ? "h" : "speed", 24 + main + 40, second);
  if (data.lanes.length) {
    rest.append(svg("clipPath", { id: "clip-lanes" }, svg("rect", { x: MARGIN.left, y: lanesTop - 20, width: axisWidth - MARGIN.left - MARGIN.right, height: LANE * data.lanes.length + 30 })));
    const heading = svg("text", { x: 0, y: lanesTop - 24, class: "panel" }, "What became of the estimates");
    heading.append(svg("title", {}, "The share of each outcome; blank where a localizer said nothing."));
    rest.append(heading);
    drawLanes(rest, lanesTop);
  }
  const step = round125((state.to - state.from) / (isNarrow ? 5 : 10));
  for (let k = Math.ceil(state.from / step); k * step <= state.to; k += 1) {
    const x = timeX(k * step);
    rest.append(svg("path", { d: `M${x.toFixed(1)} 24V${bottom}`, class: "grid" }), svg("text", { x, y: bottom + 14, class: "small middle" }, tickText(k * step)));
  }
  rest.append(svg("text", { x: axisWidth - MARGIN.right, y: bottom + 25, class: "small end" }, "s"));
  const shade = state.drag ? [svg("rect", { x: Math.min(state.drag[0], state.drag[1]), y: 24, width: Math.abs(state.drag[1] - state.drag[0]), height: bottom - 24, class: "chosen" })] : [];
  const cursor = state.at === null ? [] : [svg("path", { d: `M${timeX(state.at).toFixed(1)} 24V${bottom}`, class: "cursor" })];
  data.gaps.filter((gap) => shows(gap.name) && shows("blind")).forEach((gap) => {
    const from = Math.max(state.from, gap.from), to = Math.min(state.to, gap.to);
    if (to > from) first.prepend(svg("rect", { x: timeX(from), y: 24, width: timeX(to) - timeX(from), height: main, class: `stretch ${gap.kind}` }, svg("title", {}, `${gap.name} ${gap.kind}`)));
  });
  axis.replaceChildren(rest, first, speed, ...shade, ...cursor);
}

// --- what holds at the cursor ------------------------------------------------------------------------------------

function drawReadout() {
  const time = state.at === null ? data.span : state.at, rows = [];
  // While a run goes on the truth comes a little later than the rest: errors are of where it was known last.
  const known = state.isFollowing && compared.length ? Math.min(time, Math.max(...compared.map((track) => track.clock[track.distance.findLastIndex(Number.isFinite)]))) : time;
  tracks.filter((track) => shows(track.name)).forEach((track) => {
    const place = placeAt(track, known);
    const error = place && track.distance ? track.distance[place.i] * data.per_m : NaN, turn = place && track.turn ? (track.turn[place.i] * 180) / Math.PI : NaN;
    const swatch = node("i", { className: "swatch" });
    swatch.style.background = `var(${track.colour})`;
    rows.push(node("tr", {}, node("th", { scope: "row" }, swatch, track.name), node("td", { textContent: number(error) }), node("td", { textContent: number(turn) })));
  });
  const head = node("tr", {}, node("th", { textContent: `at ${number(known)} s` }), node("th", { textContent: data.unit }), node("th", { textContent: "°" }));
  const parts = [node("table", {}, node("caption", { textContent: compared.length ? `Position and heading ${WORD}` : "" }), node("thead", {}, head), node("tbody", {}, ...rows))];
  if (beliefs) {
    const i = before(beliefs.t, time);
    parts.push(node("p", { textContent: `±3 σ of the belief: ${number(3 * beliefs.ahead[i] * data.per_m)} ${data.unit} ahead, ${number(3 * beliefs.left[i] * data.per_m)} ${data.unit} across, ${number((540 / Math.PI) * beliefs.turn[i])}°` }));
  }
  const speed = placeAt(fused, time);
  if (speed) parts.push(node("p", { textContent: `Speed ${number(fused.speed[speed.i])} m/s` }));
  data.gaps.filter((gap) => gap.from <= time && time <= gap.to && gap.to < data.span).forEach((gap) => parts.push(node("p", { className: "told", textContent: gap.kind === "lost" ? `${gap.name} is lost: ${gap.reason}` : `${gap.name} says nothing for ${number(gap.to - gap.from)} s` })));
  [...new Set(pictures.map((picture) => picture.sensor))].slice(0, 2).forEach((sensor) => {
    const near = pictures.filter((picture) => picture.sensor === sensor).reduce((a, b) => (Math.abs(b.t - time) < Math.abs(a.t - time) ? b : a));
    parts.push(node("figure", {}, node("img", { src: near.src, alt: near.alt }), node("figcaption", { textContent: near.alt })));
  });
  $("readout").replaceChildren(...parts);
}

// --- hands -------------------------------------------------------------------------------------------------------

let isWaiting = false;
function draw() { if (data) { drawMap(); drawAxis(); drawReadout(); } }
function later() {
  if (isWaiting) return;
  isWaiting = true;
  requestAnimationFrame(() => { isWaiting = false; draw(); });
}
const point = (element, time) => { state.at = time === null ? null : Math.max(0, Math.min(data.span, time)); follow(false); };
function follow(isFollowing) {
  state.isFollowing = isFollowing;
  if (isFollowing) state.at = data.span;
  $("newest").hidden = isFollowing || !data.isGoingOn;
  later();
}

function setWindow(from, to) {
  [state.from, state.to] = to - from < data.span / 2000 ? [0, data.span] : [Math.max(0, from), Math.min(data.span, to)];
  $("whole").hidden = isWhole();
  if (view.isFitted || isWhole()) view.isFitted = true;
  later();
}
axis.addEventListener("pointermove", (event) => {
  const x = event.clientX - axis.getBoundingClientRect().left;
  if (state.drag) state.drag[1] = x;
  point(axis, Math.max(state.from, Math.min(state.to, xTime(x))));
});
axis.addEventListener("pointerdown", (event) => { if (event.pointerType === "mouse") { const x = event.clientX - axis.getBoundingClientRect().left; state.drag = [x, x]; axis.setPointerCapture(event.pointerId); } });
axis.addEventListener("pointerup", () => {
  if (!state.drag) return;
  const [a, b] = state.drag.map(xTime).sort((p, q) => p - q), isWide = Math.abs(state.drag[1] - state.drag[0]) > 6;
  state.drag = null;
  if (isWide) setWindow(a, b);
  later();
});
axis.addEventListener("pointercancel", () => { state.drag = null; later(); });
axis.addEventListener("dblclick", () => setWindow(0, data.span));
axis.addEventListener("keydown", (event) => {
  const step = (state.to - state.from) / 100, at = state.at === null ? state.from : state.at, half = (state.to - state.from) / 2;
  const keys = {
    ArrowRight: () => point(axis, Math.min(state.to, at + step)), ArrowLeft: () => point(axis, Math.max(state.from, at - step)), Escape: () => setWindow(0, data.span),
    "+": () => setWindow(at - half / 2, at + half / 2), "-": () => setWindow(at - 2 * half, at + 2 * half),
  };
  if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
});

const fingers = new Map();
let grip = null;
map.addEventListener("pointerdown", (event) => {
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  map.setPointerCapture(event.pointerId);
  map.focus({ preventScroll: true });
});
map.addEventListener("pointermove", (event) => {
  const box = map.getBoundingClientRect(), last = fingers.get(event.pointerId);
  if (last && (event.pointerType === "mouse" || fingers.size > 1)) {
    const [dx, dy] = [(event.clientX - last[0]) / fingers.size, (event.clientY - last[1]) / fingers.size];
    view.x -= dx / view.scale;
    view.y += dy / view.scale;
    view.isFitted = false;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) {
      const [[ax, ay], [bx, by]] = [...fingers.values()], apart = Math.hypot(ax - bx, ay - by);
      if (grip) zoom(apart / grip, (ax + bx) / 2 - box.left, (ay + by) / 2 - box.top);
      grip = apart;
    }
    later();
    return;
  }
  const [px, py] = [event.clientX - box.left, event.clientY - box.top];
  let best = 900, found = null;
  fused.t.forEach((t, i) => {
    if (!(t >= state.from && t <= state.to)) return;
    const apart = (drawnX(fused, i) - px) ** 2 + (drawnY(fused, i) - py) ** 2;
    if (apart < best) [best, found] = [apart, t];
  });
  if (found !== null) point(map, found);
});
["pointerup", "pointercancel"].forEach((kind) => map.addEventListener(kind, (event) => { fingers.delete(event.pointerId); grip = null; }));
map.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && !event.metaKey && document.activeElement !== map) return;  // the page scrolls until the map was clicked
  event.preventDefault();
  const box = map.getBoundingClientRect();
  zoom(Math.exp(-Math.max(-80, Math.min(80, event.deltaY)) / 150), event.clientX - box.left, event.clientY - box.top);
}, { passive: false });
map.addEventListener("dblclick", () => { view.isFitted = true; later(); });
map.addEventListener("keydown", (event) => {
  const pan = (dx, dy) => { view.x += (dx * 60) / view.scale; view.y += (dy * 60) / view.scale; view.isFitted = false; later(); };
  const keys = { "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: () => { view.isFitted = true; later(); }, ArrowLeft: () => pan(-1, 0), ArrowRight: () => pan(1, 0), ArrowUp: () => pan(0, 1), ArrowDown: () => pan(0, -1) };
  if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
});

function chip(name, title, draws) {
  const swatch = node("i", { className: `swatch ${draws.kind || ""}` });
  if (draws.colour) swatch.style.background = `var(${draws.colour})`;
  const button = node("button", { type: "button", className: "chip", title }, swatch, name);
  const show = () => button.setAttribute("aria-pressed", String(shows(name)));
  button.onclick = () => { if (!hidden.delete(name)) hidden.add(name); show(); later(); };
  show();
  return button;
}
function showChips() {
  const chips = tracks.map((track) => chip(track.name, track.name === "groundtruth" ? "where the robot was in truth" : track === fused ? "what the estimator made of all localizers" : "this localizer by itself", { colour: track.colour }));
  if (data.taught.length) chips.push(chip("taught path", "what the robot was taught, as it is remembered", { kind: "taught" }));
  if (fixes.length) chips.push(chip("fixes", "where a localizer said that the robot is; large: not accepted", { kind: "dots" }));
  if (beliefs) chips.push(chip("ellipses", "±3 standard deviations of the belief", { kind: "ring" }));
  if (data.gaps.length) chips.push(chip("blind", "where a localizer was lost or said nothing", { kind: "blind" }));
  if (data.around.length) chips.push(chip("around", "what stands there, as far as the run knows it", { kind: "walls" }));
  const names = (items) => items.map((item) => item.textContent).join("\n");
  if (names([...$("chips").children]) !== names(chips)) $("chips").replaceChildren(...chips);  // what has the focus keeps it
}
function showQuantities() {
  const choice = $("quantity"), known = Object.keys(QUANTITIES).filter((key) => (ERRORS.includes(key) ? compared.length : key !== "offset" || offsets.length));
  if (!state.isChosen || !known.includes(state.quantity)) state.quantity = compared.length ? "distance" : "x";
  if (known.join() !== [...choice.options].map((option) => option.value).join()) choice.replaceChildren(...known.map((key) => node("option", { value: key, textContent: QUANTITIES[key].title[0].toUpperCase() + QUANTITIES[key].title.slice(1) })));
  choice.value = state.quantity;
  [$("times"), $("by-error")].forEach((item) => { item.parentElement.hidden = !compared.length || !data.errors; });
}
// Show a run. Of one that goes on (`isGoingOn`) this is called again and again: zoom, cursor and what is chosen stay.
function showDocument(told) {
  const isFirst = !data, wasWhole = isFirst || isWhole();
  take(told);
  if (wasWhole) [state.from, state.to] = [0, data.span];
  showChips();
  showQuantities();
  if (isFirst) {
    const [west, east, south, north] = data.isGoingOn ? [0, 1.8, 0, 1] : extent();  // of a run that goes on it is not known
    map.style.aspectRatio = `${Math.max(1.2, Math.min(2.6, ((east - west) * 1.12) / Math.max(1e-9, (north - south) * 1.12)))}`;
    state.isFollowing = Boolean(data.isGoingOn);
    const worst = fused.distance ? fused.distance.reduce((best, value, i) => (value > fused.distance[best] || !(fused.distance[best] >= 0) ? i : best), 0) : -1;
    state.at = worst >= 0 ? fused.t[worst] : data.span;  // the page opens where there is most to see
    $("explorer").hidden = false;
  }
  if (state.isFollowing) state.at = data.span;
  draw();
  document.documentElement.dataset.ready = "yes";
}
// Forget a run, and how it was looked at: the next document is of another.
function forgetDocument() {
  data = undefined;
  pictures = [];
  view.isFitted = true;
  $("explorer").hidden = true;
}
function build() {
  const choice = $("quantity"), times = $("times");
  choice.onchange = () => { [state.quantity, state.isChosen] = [choice.value, true]; later(); };
  times.onchange = () => { state.times = Number(times.value); later(); };
  $("by-error").onchange = (event) => { state.byError = event.target.checked; $("heat").hidden = !state.byError; later(); };
  $("closer").onclick = () => zoom(1.6);
  $("farther").onclick = () => zoom(1 / 1.6);
  $("fit").onclick = () => { view.isFitted = true; later(); };
  $("whole").onclick = () => setWindow(0, data.span);
  $("newest").onclick = () => follow(true);
  new ResizeObserver(later).observe($("explorer"));
  addEventListener("beforeprint", draw);
  const told = $("explorer-data");
  if (told) showDocument(JSON.parse(told.textContent));
}
build();
