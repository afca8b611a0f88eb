"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const read = (id) => JSON.parse(byId(id).textContent);
  const { rows } = read("report");
  const view = read("view");

  // The table as it came: rows and columns in their order, and the only place where figures are text.
  const table = byId("rows");
  const lines = [...table.tBodies[0].rows];
  const columns = [...table.tHead.rows[0].cells].map((cell) => ({ cell, key: cell.dataset.key, heading: cell.textContent }));
  const text = (row, column) => lines[row].cells[column].textContent;
  const columnOf = (key) => columns.findIndex((column) => column.key === key);

  // A field of a row or of its times, of repeated ones the median; null where there is no number.
  const number = (row, key) => {
    let value = key === "edit_ms" ? view.edit_ms[row] : key in rows[row] ? rows[row][key] : rows[row].times[key];
    if (value !== null && typeof value === "object") value = value.median;
    return typeof value === "number" ? value : null;
  };

  const element = (tag, content, properties = {}) => {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...[content].flat().filter((part) => part !== null));
    return made;
  };

  // ---- A closer look at a row ----

  const detail = byId("detail");
  const picture = (row) => {
    const from = document.querySelector(`#picture-${row + 1} img`);
    if (!from) return element("figure", element("figcaption", `Row ${row + 1} has no picture.`));
    const caption = byId(`picture-${row + 1}`).querySelector("figcaption").cloneNode(true);
    caption.querySelector("a").replaceWith(`Row ${row + 1}:`);
    return element("figure", [element("img", [], { src: from.src, alt: from.alt }), caption]);
  };
  const shownRows = () => [...table.tBodies[0].rows].filter((line) => !line.hidden).map((line) => lines.indexOf(line));

  function look(row) {
    const other = view.beside[row];
    const button = (label, title, act) => {
      const made = element("button", label, { type: "button", title });
      made.addEventListener("click", act);
      return made;
    };
    const step = (by) => () => {
      const order = shownRows();
      const to = order[order.indexOf(row) + by];
      if (to !== undefined) look(to);
    };
    const head = element("header", [
      element("h2", `Row ${row + 1}: ${view.names[row]}`, { id: "detail-title" }),
      button("\u2190", "the row above", step(-1)),
      button("\u2192", "the row below", step(1)),
      button("Close", "", () => detail.close()),
    ]);
    const { failure, warnings } = rows[row];
    const said = [...(failure ? [`No figures: ${failure.reason}`] : []), ...warnings];
    const compared = [row, ...(other === null ? [] : [other])];
    const cells = (tag, parts) => element("tr", parts.map((part, k) => element(tag, part, { className: k > 0 ? "number" : "" })));
    const figures = columns.map((column, k) => [column.heading, ...compared.map((each) => text(each, k))]).slice(1);
    detail.replaceChildren(
      head,
      element("ul", said.map((line) => element("li", line)), { hidden: said.length === 0 }),
      element("div", compared.map(picture), { className: "pair" }),
      element("table", [
        element("thead", cells("th", ["", "this row", ...(other === null ? [] : [`no cage (row ${other + 1})`])])),
        element("tbody", figures.map((line) => cells("td", line))),
      ]),
    );
    if (!detail.open) detail.showModal();
    detail.scrollTop = 0;
  }

  table.classList.add("live");
  table.tBodies[0].addEventListener("click", (event) => {
    if (window.getSelection().type === "Range") return;
    event.preventDefault();
    look(lines.indexOf(event.target.closest("tr")));
  });
  for (const figure of document.querySelectorAll("#pictures figure[data-row]")) {
    figure.classList.add("live");
    figure.querySelector("img").addEventListener("click", () => look(figure.dataset.row - 1));
  }
  // Beside a group without such a picture of its own.
  for (const figure of document.querySelectorAll("#pictures figure[data-same]")) {
    const { src, alt } = document.querySelector(`#picture-${figure.dataset.same} img`);
    figure.prepend(element("img", [], { src, alt }));
  }
  detail.addEventListener("click", (event) => {
    if (event.target === detail) detail.close();
  });

  // ---- The table ----

  let sorted = { key: "number", descending: false };
  // Numbers before texts, and rows without either last, in both directions.
  function compare(a, b, column) {
    const of = (row) => {
      if (column.key === "number") return row;
      const shown = text(row, columns.indexOf(column));
      return number(row, column.key) ?? (shown === "-" || shown === "" ? null : shown);
    };
    const [x, y] = [of(a), of(b)];
    if (x === null || y === null) return (x === null) - (y === null) || a - b;
    if (typeof x !== typeof y) return typeof x === "number" ? -1 : 1;
    const order = typeof x === "number" ? x - y : x.localeCompare(y, "en", { numeric: true });
    return (sorted.descending ? -order : order) || a - b;
  }
  for (const column of columns) {
    const button = element("button", column.heading, { type: "button" });
    column.cell.replaceChildren(button);
    button.addEventListener("click", () => {
      sorted = { key: column.key, descending: sorted.key === column.key && !sorted.descending };
      columns.forEach((other) => other.cell.removeAttribute("aria-sort"));
      column.cell.setAttribute("aria-sort", sorted.descending ? "descending" : "ascending");
      const order = [...lines.keys()].sort((a, b) => compare(a, b, column));
      table.tBodies[0].append(...order.map((row) => lines[row]));
    });
  }

  const searched = rows.map((row, k) => [view.names[k], row.failure?.reason ?? "", ...row.warnings].join(" ").toLowerCase());
  byId("filtering").hidden = false;
  byId("filter").addEventListener("input", (event) => {
    const words = event.target.value.toLowerCase().split(/\s+/).filter(Boolean);
    const kept = searched.map((said) => words.every((word) => said.includes(word)));
    lines.forEach((line, row) => (line.hidden = !kept[row]));
    for (const group of document.querySelectorAll("#pictures .group")) {
      const cards = [...group.querySelectorAll(".cards figure")];
      const own = group.querySelector(".reference figure[data-row]");
      cards.forEach((card) => (card.hidden = !kept[card.dataset.row - 1]));
      group.hidden = cards.every((card) => card.hidden) && !(own && kept[own.dataset.row - 1]);
    }
    byId("found").textContent = words.length > 0 ? `${kept.filter(Boolean).length} of ${rows.length} rows` : "";
  });

  // ---- Plots ----

  const choice = { case: byId("case"), figure: byId("figure"), log: byId("log") };
  for (const [menu, labels] of [
    [choice.case, view.cases.map((each) => each.label)],
    [choice.figure, view.figures.map((each) => each.heading)],
  ]) {
    labels.forEach((label) => menu?.append(element("option", label)));
  }
  const chosen = () => ({ group: view.cases[choice.case?.selectedIndex ?? 0], figure: view.figures[choice.figure.selectedIndex] });
  const value = (row, figure) => {
    const found = number(row, figure.key);
    return found === null ? null : found * figure.factor;
  };
  // Plotly reads some tags in texts.
  const plain = (said) => said.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
  // In lines of so many letters, broken after commas.
  const folded = (said, letters) => {
    const broken = [""];
    for (const part of said.split(/(?<=, )/)) {
      if (broken.at(-1) !== "" && broken.at(-1).length + part.length > letters) broken.push("");
      broken[broken.length - 1] += part;
    }
    return broken.map(plain);
  };
  // Beyond it a figure says only that something went wrong, and an axis that reaches it would hide all the rest.
  const ABSURD = 1e9;
  const WIDE_RANGE = 20;

  // A logarithmic axis is better than a plain one once the largest value is many times the smallest.
  function logarithmicSuits() {
    const { group, figure } = chosen();
    const values = group.lines.flatMap((line) => line.rows.map((row) => value(row, figure)));
    const drawn = values.filter((x) => x !== null && x !== 0 && Math.abs(x) < ABSURD);
    return drawn.every((x) => x > 0) && Math.max(...drawn) > WIDE_RANGE * Math.min(...drawn);
  }

  // Few enough to read, and the chosen one.
  const told = ["cage_asked", "cage_vertices", "rms_relative", "relative_rms", "edge_p95", "edge_max", "rest_rms_relative", "edit_ms", "peak_memory_bytes"];
  function hover(row, line, figure) {
    const keys = told.includes(figure.key) ? told : [...told, figure.key];
    const facts = keys.map(columnOf).filter((k) => k >= 0).map((k) => `${columns[k].heading}: ${text(row, k)}`);
    return [`<b>row ${row + 1}: ${plain(line.label)}</b>`, ...facts.map(plain)].join("<br>");
  }

  // The lines of a case: against cage size on the left ("x"), against time on the right ("x2").
  function traces(group, figure, { ink, range, drawable, letters }) {
    const made = [];
    const across = Array.from({ length: 25 }, (_, k) => 10 ** (range[0] + ((range[1] - range[0]) * k) / 24));
    const add = (side, legend, trace) => {
      const axes = side === "left" ? { xaxis: "x", yaxis: "y" } : { xaxis: "x2", yaxis: "y2" };
      made.push({ type: "scatter", hovertemplate: "%{text}<extra></extra>", legendgroup: legend, showlegend: side === "left", ...axes, ...trace });
    };
    group.lines.forEach((line, k) => {
      const y = line.rows.map((row) => value(row, figure)).map((x) => (drawable(x) ? x : null));
      const look = { name: folded(line.label, letters).join("<br>"), line: { color: line.colour ?? ink, dash: line.dash, width: 2 }, marker: { color: line.colour ?? ink, symbol: line.symbol, size: line.direct ? 12 : 9 } };
      const texts = line.rows.map((row) => hover(row, line, figure));
      const times = line.rows.map((row) => number(row, "edit_ms"));
      const points = { ...look, y, text: texts, customdata: line.rows };
      if (line.direct) {
        y.forEach((level, at) => {
          const all = (of) => across.map(() => of);
          add("left", `line ${k}`, { ...look, mode: "lines", x: across, y: all(level), text: all(texts[at]), customdata: all(line.rows[at]), showlegend: at === 0 });
        });
        add("right", `line ${k}`, { ...points, mode: "markers", x: times });
      } else {
        const sizes = line.rows.map((row) => Math.max(rows[row].cage_vertices, 1));
        add("left", `line ${k}`, { ...points, mode: "lines+markers", x: sizes });
        add("right", `line ${k}`, { ...points, mode: "lines+markers", x: times });
      }
    });
    published(group, figure).forEach(({ row, direct, y, ms, says }, k) => {
      const look = { name: "published", line: { color: ink, dash: "1px,4px", width: 1.5 }, marker: { color: ink, symbol: "x-thin", size: 10, line: { color: ink, width: 2 } } };
      const all = (of) => across.map(() => of);
      const legend = { showlegend: k === 0 };
      const point = { ...look, mode: "markers", y: [y], text: [says], customdata: [row] };
      if (direct) add("left", "published", { ...look, ...legend, mode: "lines", x: across, y: all(y), text: all(says), customdata: all(row) });
      else add("left", "published", { ...point, ...legend, x: [Math.max(rows[row].cage_vertices, 1)] });
      add("right", "published", { ...point, x: [ms], showlegend: false });
    });
    return made;
  }

  // The paper's figures beside rows, each once; it has an error and a time.
  function published(group, figure) {
    const key = { rms_relative: "published", edit_ms: "published_ms" }[figure.key];
    const found = new Map();
    for (const line of key ? group.lines : []) {
      for (const row of line.rows) {
        const y = rows[row][key];
        if (y === null) continue;
        const ms = rows[row].published_ms;
        const of = line.direct ? "no cage" : `${rows[row].cage_vertices} cage vertices`;
        const says = `<b>published, ${of}</b><br>${plain(figure.heading)}: ${+(y * figure.factor).toPrecision(4)}<br>time (ms): ${ms ?? "-"}`;
        found.set(`${line.direct} ${rows[row].cage_vertices} ${y} ${ms}`, { row, direct: line.direct, y: y * figure.factor, ms, says });
      }
    }
    return [...found.values()];
  }

  function draw(width) {
    const { group, figure } = chosen();
    const log = choice.log.checked;
    const style = getComputedStyle(document.documentElement);
    const [ink, grid, raised, quiet, accent] = ["--ink", "--line", "--raised", "--quiet", "--accent"].map((name) => style.getPropertyValue(name).trim());
    const drawable = (x) => x !== null && Math.abs(x) < ABSURD && (!log || x > 0);

    const sizes = group.lines.filter((line) => !line.direct).flatMap((line) => line.rows.map((row) => Math.max(rows[row].cage_vertices, 1)));
    const range = sizes.length > 0 ? [Math.log10(Math.min(...sizes) / 1.6), Math.log10(Math.max(...sizes) * 1.6)] : [2, 4];
    const across = width ?? plot.clientWidth;
    const wide = across > 760;
    // What a legend takes: a sample of 60 pixels and 7.5 a letter.
    const letters = Math.max(20, Math.floor((across - 80) / 7.5));
    const labels = group.lines.map((line) => folded(line.label, letters));
    const longest = Math.min(letters, Math.max(...group.lines.map((line) => line.label.length)));
    const perLine = Math.max(1, Math.floor(across / (7.5 * longest + 60)));
    const legendLines = 1 + (perLine > 1 ? Math.ceil(labels.length / perLine) : labels.flat().length);
    const data = traces(group, figure, { ink, range, drawable, letters });
    const axis = { gridcolor: grid, linecolor: ink, tickcolor: grid, showline: true, ticks: "outside", automargin: true, zeroline: false, exponentformat: "none", separatethousands: true };
    const size = { ...axis, type: "log", title: { text: "cage vertices" }, range };
    const time = { ...axis, type: "log", title: { text: "time of one edit (ms)" } };
    const upright = { ...axis, type: log ? "log" : "linear", rangemode: log ? "normal" : "tozero", title: { text: figure.heading } };
    const domain = wide ? [[0, 0.47], [0.55, 1]] : [[0, 1], [0, 1]];
    const layout = {
      width,
      height: (wide ? 440 : 800) + 26 * legendLines,
      xaxis: { ...size, domain: domain[0] },
      xaxis2: { ...time, domain: domain[1], anchor: "y2" },
      yaxis: { ...upright, domain: wide ? [0, 1] : [0.58, 1] },
      yaxis2: { ...upright, domain: wide ? [0, 1] : [0, 0.42], anchor: "x2", matches: "y" },
      legend: { orientation: "h", yref: "container", y: 0, yanchor: "bottom", x: 0 },
      margin: { l: 60, r: 12, t: 12, b: 50 },
      hovermode: "closest",
      hoverlabel: { align: "left", bgcolor: raised, bordercolor: grid, font: { color: ink, size: 12 } },
      font: { color: ink, family: style.fontFamily, size: 13 },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: quiet, activecolor: accent },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
    };
    const drawn = Plotly.react(plot, data, layout, { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d"] });
    byId("common").textContent = group.common.join("; ");
    byId("missing").textContent = missing(group, figure, log).join(" ");
    return drawn;
  }

  // What a reader would look for in vain.
  function missing(group, figure, log) {
    const all = group.lines.flatMap((line) => line.rows);
    const values = all.map((row) => value(row, figure));
    const said = [
      [values.filter((x) => x === null).length, "no such figure"],
      [values.filter((x) => x !== null && Math.abs(x) >= ABSURD).length, "one too large to draw"],
      [log ? values.filter((x) => x !== null && x <= 0).length : 0, "one of 0 or less, which a logarithmic axis has no place for"],
      [all.filter((row) => number(row, "edit_ms") === null).length, "no time of an edit"],
    ];
    const told = said.filter(([count]) => count > 0).map(([count, what]) => `${count} of ${all.length} rows ${count === 1 ? "has" : "have"} ${what}.`);
    return group.failed > 0 ? [...told, `${group.failed} more failed and ${group.failed === 1 ? "has" : "have"} no figures.`] : told;
  }

  const plot = byId("plot");
  if (view.figures.length === 0) {
    byId("missing").textContent = "No row has figures to draw.";
    return;
  }
  byId("choices").hidden = false;
  byId("choices").addEventListener("submit", (event) => event.preventDefault());
  const redraw = () => draw();
  for (const menu of [choice.case, choice.figure]) {
    menu?.addEventListener("change", () => {
      choice.log.checked = logarithmicSuits();
      draw();
    });
  }
  choice.log.addEventListener("change", redraw);
  choice.log.checked = logarithmicSuits();
  draw();
  plot.on("plotly_click", (event) => look(event.points[0].customdata));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  let wait;
  window.addEventListener("resize", () => {
    clearTimeout(wait);
    wait = setTimeout(redraw, 200);
  });
  // On paper: dark on light, as wide as a page.
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    draw(1000);
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    draw();
  });
})();
