
"use strict";
// Draws the charts and lists the failures, from counts in the page. Text is only ever set as text.
const figures = JSON.parse(document.getElementById("figures").textContent);
const { policies, tasks } = figures;
const ABSENT = -1;
const PAGE = 50; // lines of the list of failures
const at = id => document.getElementById(id);

function build(parent, tag, attributes = {}, text) {
  const made = parent.namespaceURI.endsWith("svg") || tag === "svg"
    ? document.createElementNS("http://www.w3.org/2000/svg", tag)
    : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return parent.appendChild(made);
}

const count = number => number.toLocaleString("en-GB");

// As the leaderboard's: none and all without a decimal, and a tie goes to the even digit (56.25 to 56.2).
function percent(share) {
  const value = 100 * share;
  if (share <= 0 || share >= 1) return value.toFixed(0);
  return (value % 1 === 0.25 ? value - 0.01 : value).toFixed(1);
}

const stroke = policy => `c${policy % 8} d${Math.floor(policy / 8) % 4}`;
const fill = policy => `f${policy % 8}`;

// What is shown: one task or all, and the policies ticked.
const hidden = new Set();
const task = () => (at("task").value === "" ? null : Number(at("task").value));
const visible = policy =>
  !hidden.has(policy) && (at("privileged").checked || !policies[policy].privileged);
const shown = () => policies.map((_, policy) => policy).filter(visible);
const shownTasks = () => (task() === null ? tasks.map((_, i) => i) : [task()]);

// One policy's counts over the tasks shown, of a list that every cell has.
function sum(policy, list) {
  const cells = figures.cells.filter(
    cell => cell.policy === policy && (task() === null || cell.task === task()));
  const total = cells.length ? cells[0][list].map(() => 0) : [];
  for (const cell of cells) cell[list].forEach((value, i) => { total[i] += value; });
  return { n: cells.reduce((n, cell) => n + cell.n, 0), counts: total };
}

// ---- tables that sort

function sortable(table) {
  const body = table.tBodies[0];
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    const title = head.textContent;
    head.textContent = "";
    build(head, "button", { type: "button" }, title).addEventListener("click", () => {
      const numbers = title !== "Policy";
      const first = numbers && title !== "#" ? "descending" : "ascending";
      const other = first === "ascending" ? "descending" : "ascending";
      const order = head.getAttribute("aria-sort") === first ? other : first;
      for (const cell of table.tHead.rows[0].cells) cell.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", order);
      const sign = order === "ascending" ? 1 : -1;
      const key = row => row.cells[column].dataset.value ?? row.cells[column].textContent;
      const compare = numbers ? (a, b) => key(a) - key(b) : (a, b) => key(a).localeCompare(key(b));
      body.append(...[...body.rows].sort((a, b) => sign * compare(a, b)));
    });
  });
}

function plainTable(parent, title, head, lines) {
  const frame = build(parent, "div",
    { class: "frame", role: "region", "aria-label": title, tabindex: 0 });
  const table = build(frame, "table", { class: "plain" });
  const top = build(build(table, "thead"), "tr");
  for (const text of head) build(top, "th", { scope: "col" }, text);
  const body = build(table, "tbody");
  for (const line of lines) {
    const row = build(body, "tr");
    line.forEach((text, i) => build(row, i ? "td" : "th", i ? {} : { scope: "row" }, text));
  }
  return table;
}

function asTable(parent, title, head, lines) {
  const details = build(parent, "details", { class: "chart" });
  build(details, "summary", {}, "As a table");
  plainTable(details, title, head, lines);
}

function filterLeaderboard() {
  const names = new Set(shown().map(policy => policies[policy].name));
  for (const row of document.querySelectorAll("tr[data-policy]")) {
    row.hidden = !names.has(row.dataset.policy);
  }
  for (const cell of document.querySelectorAll("[data-task]")) {
    cell.hidden = task() !== null && cell.dataset.task !== tasks[task()];
  }
}

// ---- bars by task and family

function drawBars(parent) {
  for (const index of shownTasks()) {
    const cells = figures.cells.filter(cell => cell.task === index && visible(cell.policy));
    if (!cells.length) continue;
    const card = build(parent, "div", { class: "card" });
    build(card, "h3", {}, tasks[index]);
    const families = [...new Set(cells.flatMap(cell => cell.families.map(line => line[0])))].sort();
    const lines = families.map(name => [name, cells.flatMap(cell =>
      cell.families.filter(line => line[0] === name).map(line => [cell.policy, ...line.slice(1)]))]);
    if (lines.length > 1) {
      lines.unshift(["all families", cells.map(cell => [cell.policy, ...cell.success])]);
    }
    const bar = 15, label = 19, gap = 8;
    const height = lines.reduce((sum, [, bars]) => sum + label + bars.length * bar + gap, 0);
    const longest = Math.max(...cells.map(cell => policies[cell.policy].name.length));
    const letters = Math.min(longest, 16), left = 6.6 * letters + 6;
    const width = card.clientWidth - 26, room = Math.max(40, width - 108 - left);
    const title = `Success on ${tasks[index]} by scene family; the figures are in the table below`;
    const svg = build(card, "svg", { width, height, role: "img", "aria-label": title });
    let y = 0;
    for (const [name, bars] of lines) {
      build(svg, "text", { class: "head", x: 0, y: y + 13 }, name);
      y += label;
      for (const [policy, k, n, low, high] of bars) {
        const whole = policies[policy].name;
        const short = whole.length > letters ? `${whole.slice(0, letters - 1)}…` : whole;
        const named = build(svg, "text", { class: "named", x: 0, y: y + bar - 5 }, short);
        build(named, "title", {}, whole);
        build(svg, "rect", { class: "track", x: left, y, width: room, height: bar - 3 });
        const solid = build(svg, "rect",
          { class: fill(policy), x: left, y, width: room * k / n, height: bar - 3 });
        build(solid, "title", {}, `${whole}: ${k}/${n}`);
        const middle = y + (bar - 3) / 2;
        const d = `M${left + room * low} ${middle}H${left + room * high}`;
        for (const kind of ["halo", "whisker"]) build(svg, "path", { class: kind, d });
        build(svg, "text", { class: "faint", x: left + room + 6, y: y + bar - 4 },
          `${percent(k / n)} (${k}/${n})`);
        y += bar;
      }
      y += gap;
    }
    asTable(card, title, ["Policy", "Family", "k/n", "%", "95 % interval"],
      lines.flatMap(([name, bars]) => bars.map(([policy, k, n, low, high]) =>
        [policies[policy].name, name, `${k}/${n}`, percent(k / n),
          `[${percent(low)}, ${percent(high)}]`])));
  }
}

// ---- curves: the share of a policy's episodes against something

function drawCurves(parent, { title, list, grid, place, ticks, marks = [], samples, unit }) {
  const curves = shown().map(policy => [policy, sum(policy, list)]).filter(([, line]) => line.n);
  if (!curves.length) return void build(parent, "p", { class: "note" }, "No policy is shown.");
  const left = 40, bottom = 40, top = 10;
  const width = Math.max(parent.clientWidth, 200), height = Math.min(380, 0.3 * width + 180);
  const across = grid.map(place), first = across[0], last = across[across.length - 1];
  const x = value => left + (place(value) - first) / (last - first) * (width - left - 14);
  const y = share => top + (1 - share) * (height - top - bottom);
  const svg = build(parent, "svg",
    { width, height, role: "img", "aria-label": `${title}; the figures are in the table below` });
  for (const share of [0, 0.25, 0.5, 0.75, 1]) {
    build(svg, "path", { class: "axis", d: `M${left} ${y(share)}H${width - 14}` });
    build(svg, "text", { class: "faint", x: left - 6, y: y(share) + 4, "text-anchor": "end" },
      `${100 * share}%`);
  }
  for (const [value, text] of ticks) {
    build(svg, "path", { class: "axis", d: `M${x(value)} ${y(0)}v5` });
    build(svg, "text", { class: "faint", x: x(value), y: y(0) + 18, "text-anchor": "middle" }, text);
  }
  for (const value of marks) build(svg, "path", { class: "mark", d: `M${x(value)} ${top}V${y(0)}` });
  build(svg, "text", { class: "faint", x: width - 14, y: height - 4, "text-anchor": "end" }, unit);
  for (const [policy, { n, counts }] of curves) {
    const points = counts.map((k, i) => `${x(grid[i]).toFixed(1)} ${y(k / n).toFixed(1)}`);
    const line = build(svg, "path", { class: `line ${stroke(policy)}`, d: `M${points.join("L")}` });
    build(line, "title", {}, policies[policy].name);
  }
  const nearest = value => grid.reduce((best, other, i) =>
    Math.abs(other - value) < Math.abs(grid[best] - value) ? i : best, 0);
  const places = samples.map(([value]) => nearest(value));
  asTable(parent, title, ["Policy", "n", ...samples.map(([, text]) => text)],
    curves.map(([policy, { n, counts }]) => [policies[policy].name, count(n),
      ...places.map(i => percent(counts[i] / n) + " %")]));
}

function drawTimes(parent) {
  const ticks = [0, 2, 4, 6, 8, 10, 12, 14, 16].map(t => [t, String(t)]);
  const samples = [2, 4, 6, 8, 10, 12, 14].map(t => [t, `${t} s`]);
  const end = figures.times[figures.times.length - 1];
  drawCurves(parent, {
    title: "Success against time", list: "times", grid: figures.times, place: t => t, ticks,
    samples: [...samples, [end, `${end.toFixed(1)} s`]], unit: "time [s]",
  });
}

function drawErrors(parent) {
  const ticks = [[1e-4, "0.1 mm"], [1e-3, "1 mm"], [1e-2, "1 cm"], [1e-1, "10 cm"], [1, "1 m"]];
  drawCurves(parent, {
    title: "Final position error", list: "errors", grid: figures.errors, place: Math.log10, ticks,
    marks: [0.01, 0.05], samples: ticks.map(([value, text]) => [value, `< ${text}`]),
    unit: "position error",
  });
}

function drawDepths(parent) {
  const ticks = [[1e-5, "0.01 mm"], [1e-4, "0.1 mm"], [1e-3, "1 mm"], [1e-2, "1 cm"], [1e-1, "10 cm"]];
  const samples = [[1e-5, "0.01 mm"], [5e-5, "0.05 mm"], [1e-4, "0.1 mm"], [5e-4, "0.5 mm"],
    [1e-3, "1 mm"], [3e-3, "3 mm"], [5e-3, "5 mm"], [1e-2, "1 cm"]];
  drawCurves(parent, {
    title: "Success against allowed depth of contact", list: "depths", grid: figures.depths,
    place: Math.log10, ticks, marks: [5e-5], samples, unit: "allowed depth",
  });
}

// ---- histograms of clearance

function drawClearances(parent) {
  const edges = figures.clearances.map(edge => Math.round(100 * edge)); // [cm]
  const zero = edges.indexOf(0);
  const bins = ["", ...edges].map((low, i) =>
    i === 0 ? `below ${edges[0]}` : i === edges.length ? `${low} and more` : `${low} to ${edges[i]}`);
  const columns = shown().map(policy => [policy, sum(policy, "clearances")])
    .map(([policy, { counts }]) => [policy, counts, counts.reduce((a, b) => a + b, 0)])
    .filter(([, , n]) => n);
  const most = Math.max(...columns.map(([, counts, n]) => Math.max(...counts) / n));
  for (const [policy, counts, n] of columns) {
    const card = build(parent, "div", { class: "card" });
    build(card, "h3", {}, policies[policy].name);
    const width = card.clientWidth - 26, height = 150, bottom = 30, left = 34, top = 6;
    const step = (width - left) / counts.length;
    const y = share => top + (1 - share / most) * (height - top - bottom);
    const title = `Smallest clearance, ${policies[policy].name}`;
    const svg = build(card, "svg",
      { width, height, role: "img", "aria-label": `${title}; the figures are in the table below` });
    for (const share of [0, most / 2, most]) {
      build(svg, "path", { class: "axis", d: `M${left} ${y(share)}H${width}` });
      build(svg, "text", { class: "faint", x: left - 5, y: y(share) + 4, "text-anchor": "end" },
        `${(100 * share).toFixed(0)}%`);
    }
    counts.forEach((k, i) => {
      const bar = build(svg, "rect", {
        class: i <= zero ? "hit" : "clear", x: left + i * step + 0.5, y: y(k / n),
        width: Math.max(step - 1, 1), height: y(0) - y(k / n),
      });
      build(bar, "title", {}, `${bins[i]} cm: ${k} of ${n}`);
    });
    edges.forEach((edge, i) => {
      if (edge % 5) return;
      build(svg, "text", { class: "faint", x: left + (i + 1) * step, y: y(0) + 15,
        "text-anchor": "middle" }, edge);
    });
    build(svg, "text", { class: "faint", x: width, y: height - 1, "text-anchor": "end" },
      "smallest clearance [cm]");
    asTable(card, title, ["Clearance [cm]", "episodes", "%"],
      counts.map((k, i) => [bins[i], count(k), percent(k / n)]).filter((_, i) => counts[i]));
  }
  if (!columns.length) build(parent, "p", { class: "note" }, "No policy is shown.");
}

// ---- pictures of failures, and recordings that lie beside the results

const { gallery } = figures;
const kept = new Map(gallery.kept);
const KIND = { ".mp4": "video", ".webp": "video", ".mcap": "recording" };

function recordings(i) {
  const name = `${tasks[columns.task[i]]}-${String(columns.id[i]).padStart(5, "0")}`;
  return (kept.get(i) ?? []).map(kind => gallery.kinds[kind]).map(suffix =>
    [`${gallery.folders[columns.replay[i]]}/${name}${suffix}`, KIND[suffix]]);
}

function linkRecordings(parent, i) {
  for (const [href, text] of recordings(i)) {
    build(parent, "a", { href }, text);
    parent.append(" ");
  }
}

function drawPictures(parent, found) {
  const listed = new Set(found);
  parent.textContent = "";
  for (const [i, src] of gallery.pictures) {
    if (!listed.has(i)) continue;
    const figure = build(parent, "figure");
    const name = `${policies[columns.policy[i]].name}, ${tasks[columns.task[i]]} ${columns.id[i]}`;
    const [first] = recordings(i);
    build(first ? build(figure, "a", { href: first[0] }) : figure, "img",
      { src, alt: `${name}, ${told(i)}`, width: 240, height: 180 });
    const caption = build(figure, "figcaption");
    build(caption, "b", {}, name);
    build(caption, "span", {}, told(i));
    if (first) linkRecordings(build(caption, "span"), i);
    else build(caption, "code", {}, replay(i));
  }
  parent.hidden = !parent.children.length;
}

function listGrids(parent) {
  const grids = gallery.grids.flatMap((names, file) =>
    names.map(name => `${gallery.folders[file]}/${name}`));
  if (!grids.length) return;
  const line = build(parent, "p", {}, "Videos of many episodes:");
  for (const href of grids) {
    line.append(" ");
    build(line, "a", { href }, decodeURIComponent(href));
  }
}

// ---- failures

const { columns, families, links, statuses, replays } = figures.failures;
const chosen = { reason: "", family: "", link: "" };
let order = { column: null, sign: 1 };
let page = 0;

const failing = () => columns.id.map((_, i) => i).filter(i =>
  visible(columns.policy[i]) && (task() === null || columns.task[i] === task()));

function drawReasons(parent, found) {
  const counts = new Map(shown().map(policy => [policy, figures.reasons.map(() => 0)]));
  for (const i of found) counts.get(columns.policy[i])[columns.reason[i]] += 1;
  plainTable(parent, "Failures by reason", ["Policy", "failures", ...figures.reasons],
    [...counts].map(([policy, reasons]) => [policies[policy].name,
      count(reasons.reduce((a, b) => a + b, 0)), ...reasons.map(count)]));
}

const replay = i =>
  `${replays[columns.replay[i]]} --id ${columns.id[i]} --task ${tasks[columns.task[i]]}`;

function told(i) {
  const link = columns.link[i], status = columns.status[i];
  const said = [figures.reasons[columns.reason[i]]];
  if (status !== ABSENT) said.push(statuses[status]);
  if (link !== ABSENT) said.push(`${links[link]} at step ${columns.step[i]}`);
  return said.join(": ");
}

const FIELDS = [
  ["Policy", i => policies[columns.policy[i]].name, "policy"],
  ["Task", i => tasks[columns.task[i]], "task"],
  ["Id", i => columns.id[i], "id"],
  ["Family", i => families[columns.family[i]], "family"],
  ["Reason", told, "reason"],
  ["Error [cm]", i => fixed(columns.position[i], 100, 2), "position"],
  ["Error [°]", i => fixed(columns.orientation[i], 10, 1), "orientation"],
  ["To see it", replay, null],
];
const NUMBERS = new Set(["id", "position", "orientation"]);
const fixed = (value, scale, digits) => (value === ABSENT ? "–" : (value / scale).toFixed(digits));

function select(parent, label, name, values) {
  const field = build(build(parent, "label", {}, label + " "), "select", { "data-filter": name });
  build(field, "option", { value: "" }, "all");
  values.forEach((text, value) => build(field, "option", { value }, text));
  field.value = chosen[name];
  field.addEventListener("change", () => { chosen[name] = field.value; page = 0; listFailures(); });
}

function prepareFailures(parent) {
  const tools = build(parent, "div", { class: "tools" });
  select(tools, "Reason", "reason", figures.reasons);
  select(tools, "Family", "family", families);
  select(tools, "First link to touch", "link", links);
  build(parent, "div", { id: "pictures" });
  listGrids(parent);
  const turn = build(parent, "div", { class: "tools" });
  for (const [id, text, step] of [["earlier", "Earlier", -1], ["later", "Later", 1]]) {
    build(turn, "button", { type: "button", id }, text)
      .addEventListener("click", () => { page += step; listFailures(); });
  }
  build(turn, "span", { id: "range", role: "status" });
  const frame = build(parent, "div",
    { class: "frame", role: "region", "aria-label": "Failures", tabindex: 0 });
  const table = build(frame, "table", { class: "list" });
  const head = build(build(table, "thead"), "tr");
  for (const [title, , column] of FIELDS) {
    const cell = build(head, "th", { scope: "col" }, column ? undefined : title);
    if (!column) continue;
    build(cell, "button", { type: "button" }, title).addEventListener("click", () => {
      order = { column, sign: order.column === column ? -order.sign : 1 };
      for (const other of head.cells) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", order.sign > 0 ? "ascending" : "descending");
      page = 0;
      listFailures();
    });
  }
  build(table, "tbody", { id: "failed" });
}

function listFailures() {
  const found = failing().filter(i => Object.entries(chosen).every(
    ([name, value]) => value === "" || columns[name][i] === Number(value)));
  if (order.column) {
    const values = columns[order.column];
    found.sort((a, b) => order.sign * (values[a] - values[b]) || a - b);
  }
  drawPictures(at("pictures"), found);
  const first = page * PAGE, lines = found.slice(first, first + PAGE);
  at("range").textContent = found.length
    ? `${count(first + 1)} to ${count(first + lines.length)} of ${count(found.length)}` : "none";
  at("earlier").disabled = page === 0;
  at("later").disabled = first + PAGE >= found.length;
  const body = at("failed");
  body.textContent = "";
  for (const i of lines) {
    const row = build(body, "tr");
    for (const [, text, column] of FIELDS) {
      const kind = NUMBERS.has(column) ? { class: "number" } : {};
      const cell = build(row, "td", kind, column ? text(i) : undefined);
      if (column) continue;
      linkRecordings(cell, i);
      build(cell, "code", {}, text(i));
    }
  }
}

// ---- the whole page

function redraw() {
  filterLeaderboard();
  for (const [id, draw] of Object.entries(
    { bars: drawBars, times: drawTimes, clearances: drawClearances, depths: drawDepths,
      errors: drawErrors })) {
    at(id).textContent = "";
    draw(at(id));
  }
  at("reasons").textContent = "";
  drawReasons(at("reasons"), failing());
  page = 0;
  listFailures();
}

build(at("task"), "option", { value: "" }, "all");
tasks.forEach((name, i) => build(at("task"), "option", { value: i }, name));
at("task").addEventListener("change", redraw);
at("privileged").addEventListener("change", redraw);
at("privileged-label").hidden = !policies.some(policy => policy.privileged);
policies.forEach(({ name, privileged }, policy) => {
  const label = build(at("policies"), "label");
  const box = build(label, "input", { type: "checkbox", checked: "" });
  const swatch = build(label, "svg", { class: "swatch", viewBox: "0 0 26 10", "aria-hidden": true });
  build(swatch, "path", { class: `line ${stroke(policy)}`, d: "M0 5H26", "stroke-width": 4 });
  build(label, "span", {}, name + (privileged ? "†" : ""));
  box.addEventListener("change", () => {
    if (box.checked) hidden.delete(policy); else hidden.add(policy);
    redraw();
  });
});
at("shown").addEventListener("submit", event => event.preventDefault());
at("shown").hidden = false;
document.querySelectorAll("table.sortable").forEach(table => sortable(table));
prepareFailures(at("failures"));
redraw();
let width = document.body.clientWidth;
addEventListener("resize", () => {
  if (document.body.clientWidth === width) return;
  width = document.body.clientWidth;
  redraw();
});
