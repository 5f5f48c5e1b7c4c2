"use strict";
(() => {
  // Tables are sorted by a press on a heading; without this script they stand as they were written.
  const number = (text) => {
    const value = Number.parseFloat(text.replace("<", ""));
    return Number.isNaN(value) ? null : value;
  };
  const compare = (a, b, down) => {
    const [x, y] = [number(a), number(b)];
    if (x === null && y === null) return down * a.localeCompare(b, "en", { numeric: true });
    if (x === null) return 1; // what does not exist stands last either way
    return y === null ? -1 : down * (x - y);
  };
  const sort = (head, column) => {
    const down = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const names = head.classList.contains("t") || column === 0;
    const text = (row) => row.cells[column].textContent;
    for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down === 1 ? "ascending" : "descending");
    const rows = [...head.closest("table").tBodies[0].rows];
    rows.sort((one, two) => names
      ? down * text(one).localeCompare(text(two), "en", { numeric: true })
      : compare(text(one), text(two), down));
    head.closest("table").tBodies[0].append(...rows);
  };
  for (const table of document.querySelectorAll("table[id]")) {
    if (table.tBodies.length !== 1 || table.tBodies[0].rows.length < 3) continue;
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-label", `Sort by ${head.textContent.trim()}`);
      head.addEventListener("click", () => sort(head, column)); // a press on the button, too
      head.append("\u00a0", button); // never alone in a line
    });
  }
  // Paper and links show what is folded.
  const folded = () => document.querySelectorAll("details:not([open])");
  addEventListener("beforeprint", () => {
    for (const one of folded()) { one.open = true; one.dataset.folded = ""; }
  });
  addEventListener("afterprint", () => {
    for (const one of document.querySelectorAll("details[data-folded]")) {
      one.open = false; delete one.dataset.folded;
    }
  });
  const unfold = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let one = target; one; one = one.parentElement) if (one.tagName === "DETAILS") one.open = true;
    target.querySelector(":scope > details")?.setAttribute("open", "");
    target.scrollIntoView();
  };
  addEventListener("hashchange", unfold);
  unfold();
})();
