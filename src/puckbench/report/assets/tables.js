// Tables that sort by a click on a heading and show only the rows that are asked for.
"use strict";

const MOST_CHOICES = 30;
const LONGEST = 40; // characters of a value that one can choose
const FOLDED = { spread: "quartiles, 5 and 95 %", bookkeeping: "all columns" }; // shown when asked for
const byText = new Intl.Collator("en", { numeric: true }).compare; // r2 before r10

function setUpTables() {
  document.querySelectorAll("table.data").forEach(setUpTable);
}

function setUpTable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const rows = [...table.tBodies[0].rows];
  heads.forEach((head, column) => addSorting(table, head, column));
  const holder = table.closest(".scroll");
  const counted = element("output", { class: "count" });
  const wanted = { words: "", chosen: new Map() };
  const show = () => {
    const shown = rows.filter((row) => (row.hidden = !matches(row, wanted)) === false).length;
    counted.textContent = shown === rows.length ? `${rows.length} rows` : `${shown} of ${rows.length} rows`;
  };
  const controls = element("div", { class: "controls" }, wordsField(wanted, show));
  heads.forEach((head, column) => {
    const names = distinct(rows, column);
    const short = names.length > 1 && names.length <= MOST_CHOICES && names.every((name) => name.length <= LONGEST);
    if (!short || head.matches(".number, .bookkeeping")) return;
    controls.append(columnChoice(head.dataset.name, names, column, wanted, show));
  });
  for (const [kind, words] of Object.entries(FOLDED)) {
    if (table.querySelector(`.${kind}`)) controls.append(folding(table, kind, words));
  }
  controls.append(counted);
  holder.before(controls);
  show();
}

function addSorting(table, head, column) {
  head.dataset.name = head.firstChild.textContent;
  const button = element("button", { type: "button", onclick: () => sort(table, head, column) });
  button.append(...head.childNodes);
  head.append(button);
}

/** Sort by a column: rising at first, falling the next time; empty cells stay last. */
function sort(table, head, column) {
  const rising = head.getAttribute("aria-sort") !== "ascending";
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  const numbers = head.classList.contains("number");
  const compare = numbers ? (a, b) => a - b : byText;
  const keyed = [...table.tBodies[0].rows].map((row) => {
    const text = row.cells[column].textContent;
    return { row, key: numbers && text ? Number(text) : text };
  });
  keyed.sort((a, b) => {
    if (a.key === "" || b.key === "") return (a.key === "") - (b.key === "");
    return rising ? compare(a.key, b.key) : compare(b.key, a.key);
  });
  table.tBodies[0].append(...keyed.map(({ row }) => row));
}

function distinct(rows, column) {
  return [...new Set(rows.map((row) => row.cells[column].textContent))].sort(byText);
}

/** Whether a row has all the words, in any cells, and the chosen value in each chosen column. */
function matches(row, { words, chosen }) {
  for (const [column, value] of chosen) {
    if (value && row.cells[column].textContent !== value) return false;
  }
  const text = words && row.textContent.toLowerCase();
  return words.split(/\s+/).every((word) => !word || text.includes(word));
}

function wordsField(wanted, show) {
  const input = element("input", {
    type: "search",
    oninput: () => {
      wanted.words = input.value.toLowerCase();
      show();
    },
  });
  return element("label", {}, element("span", {}, "Rows with"), input);
}

function columnChoice(name, values, column, wanted, show) {
  const options = [["", "all"], ...values.filter((v) => v).map((value) => [value, value])];
  return choice(name, options, "", (value) => {
    wanted.chosen.set(column, value);
    show();
  });
}

function folding(table, kind, words) {
  const show = (shown) => table.classList.toggle(`without-${kind}`, !shown);
  show(false);
  return box(words, false, show);
}
