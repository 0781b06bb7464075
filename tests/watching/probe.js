// Looks at a page of a run that goes on, presses Stop, and writes what it found to the page, which the browser prints.
window.told = [];
window.requestAnimationFrame = (draw) => setTimeout(draw, 16);  // a browser without a window draws no frames
addEventListener("error", (event) => told.push(event.message));
addEventListener("unhandledrejection", (event) => told.push(String(event.reason)));
addEventListener("securitypolicyviolation", (event) => told.push(`policy: ${event.violatedDirective}`));
const until = async (condition) => {
  for (let i = 0; i < 200 && !condition(); i += 1) await new Promise((done) => setTimeout(done, 100));
};
const probe = async () => {
  const element = (id) => document.getElementById(id), found = {};
  const stop = document.querySelector("[data-press=stop]");
  const tell = () => [element("status").textContent, element("status").classList.contains("live"), stop.disabled];
  const grid = () => element("map").querySelector(".grid").getAttribute("d");
  await until(() => document.documentElement.dataset.ready === "yes" && data.span > 0);
  found.live = tell();
  found.tracks = element("map").querySelectorAll("path.track").length;
  found.follows = [state.at];
  element("closer").click();
  [...document.querySelectorAll(".chip")].find((chip) => chip.textContent === "wheels").click();
  await until(() => element("map").querySelectorAll("path.track").length === 2);
  const zoomed = grid(), span = data.span;
  await until(() => data.span > span);
  found.follows.push(state.at);
  found.zoom_kept = grid() === zoomed;
  found.hidden_kept = element("map").querySelectorAll("path.track").length === 2;
  point(null, 1.5);
  await until(() => document.querySelector("#readout img"));
  found.pictures = document.querySelectorAll("#readout img").length;
  found.text = [element("name").textContent, document.querySelector("#health tbody th").textContent];
  stop.click();
  await until(() => element("report").querySelector("a"));
  found.ended = tell();
  found.cursor_kept = state.at === 1.5;
  found.report = element("report").querySelector("a").href;
  found.errors = told;
  element("told").textContent = `PROBE${JSON.stringify(found)}END`;
};
addEventListener("load", probe);
