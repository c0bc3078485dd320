(() => {
  const { at, options } = eyechart;
  const table = document.querySelector("table.runs");
  const heads = [...table.tHead.rows[0].cells].map((one) => one.textContent);
  const rows = [...table.tBodies[0].rows];
  const names = ["model", "verdict", "of", "asked about"];
  const field = (name) => at(`f-${name.replace(" ", "-")}`);
  const cell = (row, name) => row.cells[heads.indexOf(name)]?.textContent ?? "";

  for (const name of names) {
    const every = [...new Set(rows.map((row) => cell(row, name)))].sort();
    options(field(name), [["", "any"], ...every.map((one) => [one, one])]);
    field(name).parentElement.hidden = every.length < 2;
  }
  const update = () => {
    const words = at("f-text").value.toLowerCase();
    let shown = 0;
    for (const row of rows) {
      const chosen = names.every((name) => !field(name).value || field(name).value === cell(row, name));
      row.hidden = !chosen || !row.textContent.toLowerCase().includes(words);
      shown += !row.hidden;
    }
    at("status").textContent = `${shown} of ${rows.length} rows`;
  };
  at("filters").addEventListener("input", update);
  at("filters").addEventListener("submit", (event) => event.preventDefault());
  at("f-clear").addEventListener("click", () => {
    at("filters").reset();
    update();
  });
  update();
})();
