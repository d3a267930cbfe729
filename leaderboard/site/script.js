"use strict";

// What is shown stands in the address after #, so that it can be sent to others.
function readState() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

function writeState(changes) {
  const state = new URLSearchParams();
  for (const [name, value] of Object.entries({ ...readState(), ...changes })) if (value) state.set(name, value);
  history.replaceState(null, "", "#" + state);
}

function cellKey(row, column) {
  const cell = row.cells[column];
  if (cell.dataset.value !== undefined) return Number(cell.dataset.value);
  return cell.textContent.trim();
}

// Numbers by size, texts by the alphabet; what is empty stays last either way.
function compareCells(a, b, sign) {
  if (a === "" || b === "") return (a === "") - (b === "");
  if (typeof a === "number" && typeof b === "number") return sign * (a - b);
  return sign * String(a).localeCompare(String(b), undefined, { numeric: true });
}

function sortTable(table, head, direction) {
  const body = table.tBodies[0];
  const sign = direction === "descending" ? -1 : 1;
  const rows = Array.from(body.rows, (row) => [cellKey(row, head.cellIndex), row]);
  rows.sort((a, b) => compareCells(a[0], b[0], sign));
  body.append(...rows.map(([, row]) => row));
  for (const other of table.querySelectorAll("th[aria-sort]")) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", direction);
}

function makeSortable(table) {
  for (const button of table.tHead.querySelectorAll("th > button")) {
    const head = button.parentElement;
    button.addEventListener("click", () => {
      const first = head.classList.contains("number") ? "descending" : "ascending";
      const other = first === "ascending" ? "descending" : "ascending";
      const direction = head.getAttribute("aria-sort") === first ? other : first;
      sortTable(table, head, direction);
      if (table.id && head.dataset.key) writeState({ sort: head.dataset.key, order: direction });
    });
  }
}

function filterRows(form, table) {
  const wanted = Array.from(form.elements).filter((field) => field.name && field.value);
  let shown = 0;
  for (const row of table.tBodies[0].rows) {
    const kept = wanted.every((field) => {
      const value = row.dataset[field.name];
      return field.type === "search" ? value.toLowerCase().includes(field.value.toLowerCase()) : value === field.value;
    });
    row.hidden = !kept;
    shown += kept;
  }
  form.querySelector("output").textContent = shown === table.tBodies[0].rows.length ? `${shown} runs` : `${shown} of ${table.tBodies[0].rows.length} runs`;
}

function setUpFilters(form) {
  const table = document.getElementById(form.dataset.filters);
  const fields = Array.from(form.elements).filter((field) => field.name);
  const restore = () => {
    const state = readState();
    for (const field of fields) field.value = state[field.name] || "";
    for (const field of fields) if (field.selectedIndex === -1) field.selectedIndex = 0;
    const head = Array.from(table.tHead.querySelectorAll("th")).find((one) => one.dataset.key === state.sort);
    if (head) sortTable(table, head, state.order === "ascending" ? "ascending" : "descending");
    filterRows(form, table);
  };
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", () => {
    writeState(Object.fromEntries(fields.map((field) => [field.name, field.value])));
    filterRows(form, table);
  });
  form.addEventListener("reset", () => setTimeout(() => form.dispatchEvent(new Event("input"))));
  addEventListener("hashchange", restore);
  restore();
}

function fill(select, names, wanted) {
  select.replaceChildren(...names.map((name) => new Option(name)));
  select.value = names.includes(wanted) ? wanted : names[0];
}

// `pictures`: by pattern, what is shown and view, the file's name.
function setUpViewer(form, pictures) {
  const { pattern, view, left, right, error, cut } = form.elements;
  const [under, over] = form.querySelectorAll(".compare img");
  const show = (state) => {
    fill(pattern, Object.keys(pictures), state.pattern);
    const sources = pictures[pattern.value];
    const names = Object.keys(sources).filter((name) => Object.keys(sources[name]).length);
    const last = names.filter((name) => !["rainy view", "clean view"].includes(name)).pop();
    fill(left, names, state.left || (names.includes("rainy view") ? "rainy view" : names[0]));
    fill(right, names, state.right || last);
    fill(view, Object.keys(sources[right.value]), state.view);
    for (const [image, source] of [[under, left.value], [over, right.value]]) {
      const file = sources[source][view.value];
      image.hidden = !file;
      if (file) image.src = "../pictures/" + file;
      image.alt = file ? `${source}, view ${view.value}` : `no picture of ${source}`;
    }
    form.querySelector(".compare").classList.toggle("error", error.checked);
    cut.disabled = error.checked;
  };
  const slide = () => form.querySelector(".compare").style.setProperty("--cut", cut.value + "%");
  const restore = () => {
    const state = readState();
    error.checked = state.error === "1";
    if (state.cut) cut.value = state.cut;
    show(state);
    slide();
  };
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", () => {
    const state = { pattern: pattern.value, view: view.value, left: left.value, right: right.value };
    show(state);
    slide();
    writeState({ ...state, view: view.value, error: error.checked ? "1" : "", cut: cut.value });
  });
  addEventListener("hashchange", restore);
  form.hidden = false;
  restore();
}

for (const table of document.querySelectorAll("table.sortable")) makeSortable(table);
for (const form of document.querySelectorAll("form[data-filters]")) setUpFilters(form);
const data = document.getElementById("viewer-pictures");
if (data) setUpViewer(document.querySelector("form.viewer"), JSON.parse(data.textContent));
