// The table of all logs: a click on a column's title sorts by it, and the rows that hold every word typed are shown.
const table = document.querySelector("table.logs"), body = table.tBodies[0], rows = [...body.rows];
const value = (row, column) => {
  const text = row.cells[column].textContent.trim(), size = parseFloat(text.replace("−", "-"));
  return text === "" ? null : Number.isNaN(size) || /^\d{4}-/.test(text) ? text : size;
};
const compare = (a, b) => a === null || b === null ? (a === null) - (b === null) : typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), undefined, {numeric: true});
[...table.tHead.rows[0].cells].forEach((title, column) => {
  const button = document.createElement("button");
  button.textContent = title.textContent;
  title.replaceChildren(button);
  button.addEventListener("click", () => {
    const down = title.getAttribute("aria-sort") === "ascending", sign = down ? -1 : 1;
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    title.setAttribute("aria-sort", down ? "descending" : "ascending");
    const keyed = rows.map((row) => [value(row, column), row]);
    keyed.sort(([a], [b]) => a === null || b === null ? compare(a, b) : sign * compare(a, b));
    body.append(...keyed.map(([, row]) => row));
  });
});
const typed = document.querySelector(".filter input"), shown = document.querySelector(".filter output");
const texts = rows.map((row) => row.textContent.toLowerCase());
const filter = () => {
  const words = typed.value.toLowerCase().split(/\s+/).filter(Boolean);
  let count = 0;
  rows.forEach((row, k) => { row.hidden = !words.every((word) => texts[k].includes(word)); count += !row.hidden; });
  shown.textContent = `${count} of ${rows.length}`;
};
typed.addEventListener("input", filter);
filter();
