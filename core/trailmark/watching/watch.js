"use strict";
// Asks this page's own server for the run as it is now, about once a second, and shows it by the report's script.
const EVERY_MS = 1000;
const secret = document.querySelector("header").dataset.secret;
const seen = { number: -1, run: null, pictures: new Map(), report: false };

const asData = (blob) => new Promise((done, fail) => {
  const reader = new FileReader();
  reader.onload = () => done(reader.result);
  reader.onerror = fail;
  reader.readAsDataURL(blob);
});
// Pictures are kept here: the page shows them when its server has gone.
async function fetchPictures(told) {
  const names = new Set(told.map((picture) => picture.name));
  [...seen.pictures.keys()].filter((name) => !names.has(name)).forEach((name) => seen.pictures.delete(name));
  for (const { name, sensor, t } of [...told].reverse()) {  // the newest first
    if (seen.pictures.has(name)) continue;
    const answer = await fetch(`pictures/${encodeURIComponent(name)}`).catch(() => null);
    if (answer && answer.ok) seen.pictures.set(name, { sensor, t, src: await asData(await answer.blob()), alt: `${sensor}, ${t.toFixed(1)} s` });
    pictures = [...seen.pictures.values()];
  }
}
async function fetchReport() {
  const answer = await fetch("report.html").catch(() => null);
  if (!answer || !answer.ok) return;
  seen.report = true;
  const link = node("a", { href: URL.createObjectURL(await answer.blob()), target: "_blank", textContent: "the report" });
  $("report").replaceChildren(link);
}

function showHealth({ columns, rows }) {
  const cell = (tag, text, { number }) => node(tag, { textContent: text, className: number ? "number" : "words" });
  const head = columns.map((column) => {
    const made = cell("th", column.title, column);
    made.append(node("span", { textContent: column.unit || "\u00a0" }));
    return made;
  });
  const lines = rows.map((row) => node("tr", {}, ...row.map((text, i) => cell(i ? "td" : "th", text, columns[i]))));
  $("health").querySelector("table").replaceChildren(node("thead", {}, node("tr", {}, ...head)), node("tbody", {}, ...lines));
  $("health").hidden = !rows.length;
}
function showStatus(words, isLive, note = "") {
  $("status").textContent = words;
  $("status").classList.toggle("live", isLive);
  $("told").textContent = note;
}
const buttons = [...document.querySelectorAll("[data-press]")];
function enable(names) { buttons.forEach((button) => { button.disabled = !names.includes(button.dataset.press); }); }
async function press(button) {
  const name = button.dataset.press;
  if (name === "teach" && !confirm("Teaching replaces the path in the store.")) return;
  button.disabled = true;
  const answer = await fetch(`press/${name}`, { method: "POST", headers: { "X-Trailmark-Token": secret } }).catch(() => null);
  if (answer && !answer.ok) $("told").textContent = await answer.text();
}
buttons.forEach((button) => { button.onclick = () => press(button); });

async function show(told) {
  $("name").textContent = document.title = told.name;
  if (told.run !== seen.run) {
    if (seen.run !== null) forgetDocument();
    Object.assign(seen, { run: told.run, pictures: new Map(), report: false });
    $("report").replaceChildren();
  }
  showStatus(told.status, told.isLive, told.note);
  enable(told.can);
  showHealth(told.health);
  if (told.explorer) showDocument(told.explorer);
  await fetchPictures(told.pictures);
  later();
  if (told.hasReport && !seen.report) await fetchReport();
}
async function ask() {
  const answer = await fetch(`state?after=${seen.number}`).catch(() => null);
  const told = answer && answer.status === 200 ? await answer.json().catch(() => null) : null;
  if (!answer) {
    enable([]);
    showStatus("no answer", false, "the command of this page is not there any more");
    seen.number = -1;  // if it is there again, it says everything anew
  }
  if (told) {
    seen.number = told.number;
    await show(told);
  }
  if (!told || !told.isOver) setTimeout(ask, EVERY_MS);
}
ask();
