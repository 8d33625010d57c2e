"use strict";
(() => {
  const { rows, pictures, titles, statuses } = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const GUIDANCE = [
    { key: "lateral_deviation_m", unit: "m", digits: 2, sides: ["right of", "left of"], level: "lateral_m" },
    { key: "vertical_deviation_m", unit: "m", digits: 2, sides: ["above", "below"] },
    { key: "heading_error_deg", unit: "°", digits: 2, sides: ["nose right", "nose left"], level: "heading_deg" },
    { key: "height_above_deck_m", unit: "m", digits: 2, level: "vertical_m" },
    { key: "distance_to_ramp_m", unit: "m", digits: 1, level: "distance_m" },
    { key: "lateral_deviation_widths", unit: "widths", digits: 3, sides: ["right of", "left of"] },
    { key: "height_above_deck_widths", unit: "widths", digits: 3 },
    { key: "distance_to_ramp_widths", unit: "widths", digits: 2 },
    { key: "lateral_rate_m_s", unit: "m/s", digits: 2, sides: ["right", "left"] },
    { key: "height_rate_m_s", unit: "m/s", digits: 2, sides: ["climbing", "sinking"] },
    { key: "closing_m_s", unit: "m/s", digits: 1 },
  ].filter(({ key }) => rows.some((row) => row.guidance && row.guidance[key]))
    .map((value) => ({ ...value, title: titles[value.key] }));
  const hasLevels = rows.some((row) => row.protection);
  const MARGIN = { left: 52, right: 12, top: 8, bottom: 40 };
  const DOTS_UP_TO = 80; // points on the line stay readable up to so many frames
  const known = (value) => value !== null && value !== undefined;
  const inside = (object, ...keys) => keys.reduce((value, key) => (known(value) ? value[key] : null), object) ?? null;
  const fixed = (value, digits) => value.toFixed(digits).replace("-", "−");
  const signed = (value, digits) => (value > 0 ? "+" : "") + fixed(value, digits);

  const unitAfter = (unit) => (unit && unit !== "°" ? ` ${unit}` : unit);

  // --- small builders -------------------------------------------------------------------------------------------
  function element(name, attributes = {}, text = "") {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.textContent = text;
    return node;
  }
  function shape(parent, name, attributes, text = "") {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.textContent = text;
    return parent.appendChild(node);
  }
  const flagged = (row) => Boolean(row.flags && row.flags.length);
  const statusOf = (row) => (row.skipped ? "skipped" : row.status);
  const classOf = (status) => status.replace(" ", "-");

  // --- what the plots show --------------------------------------------------------------------------------------
  const times = rows.map((row) => row.time_s).filter(known);
  const start = Math.min(...times); // Unix times are too long to be read along an axis
  const hasTime = times.some((time) => time > start);
  const hasTrueRange = rows.some((row) => known(inside(row, "truth", "distance_to_ramp_m")));
  const rangeUnit = hasTrueRange || !GUIDANCE.some(({ key }) => key === "distance_to_ramp_widths") ? "m" : "widths";
  const range = (row) => inside(row, "truth", "distance_to_ramp_m") ?? inside(row, "guidance", `distance_to_ramp_${rangeUnit}`, "value");
  const hasRange = rows.filter((row) => known(range(row))).length > 1;
  const hasErrors = rows.some((row) => GUIDANCE.some(({ key }) => known(inside(row, "errors", key))));
  const AXES = {
    time: { name: "Time", label: "time since the first frame, s", of: (row) => (known(row.time_s) ? row.time_s - start : null) },
    frame: { name: "Frame", label: "frame", of: (row, index) => index },
    range: { name: "Range", label: `${hasTrueRange ? "true" : "measured"} distance to the ramp, ${rangeUnit}`, of: range, reversed: true },
  };
  const state = { axis: hasTime ? "time" : "frame", errors: false, row: 0 };

  function guidanceChart({ key, title, unit, digits, sides, level }) {
    const measured = {
      name: "measured", style: "measured",
      value: (row) => (state.errors ? inside(row, "errors", key) : inside(row, "guidance", key, "value")),
      sigma: (row) => inside(row, "guidance", key, "sigma"),
      level: level && ((row) => inside(row, "protection", level)),
    };
    const truth = { name: "true", style: "truth", value: (row) => (state.errors ? null : inside(row, "truth", key)) };
    const exists = rows.some((row) => known(inside(row, "guidance", key)));
    return { title, unit, digits, hint: sides && `+ ${sides[0].replace(" of", "")}`, series: [measured, truth], exists, errors: true };
  }
  function pointsChart(title, unit, digits, place) {
    const series = ["left", "right"].map((side) => ({ name: side, style: `series-${side}`, value: (row) => inside(row, side, place) }));
    const exists = rows.some((row) => series.some(({ value }) => known(value(row))));
    return { title, unit, digits, series, exists, fromZero: true };
  }
  const charts = [
    ...GUIDANCE.map(guidanceChart),
    pointsChart("Line points used", "", 0, "used"),
    pointsChart("Confidence of the points, mean", "", 2, "confidence"),
  ].filter((chart) => chart.exists);

  // --- scales ---------------------------------------------------------------------------------------------------
  function ticks(low, high, count) {
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].find((factor) => factor * power >= rough) * power;
    const first = Math.ceil(low / step - 1e-9);
    const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-9) - first + 1) }, (_, i) => [(first + i) * step, places]);
  }
  const quantile = (sorted, q) => sorted[Math.min(sorted.length - 1, Math.max(0, Math.round(q * (sorted.length - 1))))];
  function domain(values, { fromZero = false, withZero = false }) {
    const sorted = [...values].sort((a, b) => a - b);
    let [low, high] = [sorted[0] ?? 0, sorted[sorted.length - 1] ?? 1];
    const [q1, q9] = [quantile(sorted, 0.02) ?? 0, quantile(sorted, 0.98) ?? 1];
    if (high - low > 3 * (q9 - q1) && q9 > q1) { // a few far outliers must not flatten the rest; they are counted below the plot
      low = Math.max(low, q1 - 0.5 * (q9 - q1));
      high = Math.min(high, q9 + 0.5 * (q9 - q1));
    }
    if (fromZero || withZero) low = Math.min(low, 0);
    if (withZero) high = Math.max(high, 0);
    const spare = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1;
    return [fromZero ? low : low - spare, high + spare];
  }

  // --- one plot -------------------------------------------------------------------------------------------------
  function drawPlot(chart) {
    const { svg, beyond } = chart;
    const width = Math.max(svg.clientWidth, 260), height = svg.clientHeight || 230;
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const axis = AXES[state.axis];
    const xs = rows.map((row, index) => axis.of(row, index));
    const seen = xs.filter(known);
    let [x0, x1] = [Math.min(...seen), Math.max(...seen)];
    if (!(x1 > x0)) [x0, x1] = [x0 - 1, x1 + 1];
    const points = chart.series.map(({ value }) => rows.map(value));
    const all = points.flat().filter(known);
    const sigmas = chart.errors ? rows.map(chart.series[0].sigma) : [];
    const bands = sigmas.flatMap((s, i) => {
      const middle = state.errors ? 0 : points[0][i];
      return known(s) && known(middle) ? [middle - s, middle + s] : [];
    });
    const [y0, y1] = domain([...all, ...bands], { fromZero: chart.fromZero, withZero: chart.errors && state.errors });
    const plot = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
    const along = (x) => (axis.reversed ? x1 - x : x - x0) / (x1 - x0);
    const px = (x) => plot.left + along(x) * (plot.right - plot.left);
    const clamp = (y) => Math.min(Math.max(y, y0), y1);
    const py = (y) => plot.bottom - ((clamp(y) - y0) / (y1 - y0)) * (plot.bottom - plot.top);
    chart.px = (index) => (known(xs[index]) ? px(xs[index]) : null);
    drawAxes(svg, plot, axis, { x0, x1, y0, y1, px, py });
    drawStrip(svg, plot, xs, px);
    for (let k = chart.series.length - 1; k >= 0; k--) drawSeries(svg, chart.series[k], points[k], { xs, px, py, joined: !axis.reversed }); // the first on top
    chart.cursor = shape(svg, "line", { class: "cursor", y1: plot.top, y2: plot.bottom + 9, x1: -9, x2: -9 });
    const outside = all.filter((y) => y < y0 || y > y1);
    const farthest = outside.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a), 0);
    beyond.textContent = outside.length ? `${outside.length} beyond the scale, drawn at its edge; farthest ${fixed(farthest, chart.digits)}${unitAfter(chart.unit)}` : "";
  }
  function drawAxes(svg, plot, axis, { x0, x1, y0, y1, px, py }) {
    for (const [y, places] of ticks(y0, y1, 5)) {
      shape(svg, "line", { class: Math.abs(y) < 1e-9 ? "zero" : "grid", x1: plot.left, x2: plot.right, y1: py(y), y2: py(y) });
      shape(svg, "text", { x: plot.left - 7, y: py(y) + 4, "text-anchor": "end" }, fixed(y, places));
    }
    for (const [x, places] of ticks(x0, x1, Math.min(8, (plot.right - plot.left) / 60)))
      shape(svg, "text", { x: px(x), y: plot.bottom + 22, "text-anchor": "middle" }, fixed(x, places));
    shape(svg, "text", { x: (plot.left + plot.right) / 2, y: plot.bottom + 37, "text-anchor": "middle" }, axis.label);
  }
  function drawStrip(svg, plot, xs, px) {
    const size = Math.max(1.5, Math.min(10, ((plot.right - plot.left) / rows.length) * 0.8));
    rows.forEach((row, index) => {
      if (known(xs[index])) shape(svg, "rect", { class: `strip ${classOf(statusOf(row))}`, x: px(xs[index]) - size / 2, y: plot.bottom + 3, width: size, height: 5 });
      if (known(xs[index]) && flagged(row)) shape(svg, "rect", { class: "strip flagged", x: px(xs[index]) - size / 2, y: plot.top, width: size, height: 5 });
    });
  }
  function drawSeries(svg, { style, sigma, level }, ys, { xs, px, py, joined }) {
    const at = (index) => known(xs[index]) && known(ys[index]);
    const spread = (index) => (sigma && known(sigma(rows[index])) ? sigma(rows[index]) : 0);
    const middle = (index) => (state.errors && sigma ? 0 : ys[index]); // an error is judged against the band about zero
    const runs = [];
    rows.forEach((row, index) => {
      if (row.skipped || !at(index)) runs.push([]);
      else if (runs.length) runs[runs.length - 1].push(index);
      else runs.push([index]);
    });
    const shown = runs.flat();
    const point = (index, y) => `${px(xs[index]).toFixed(1)},${py(y).toFixed(1)}`;
    if (level)
      for (const side of [-1, 1])
        for (const run of runs.map((r) => r.filter((i) => known(level(rows[i])))).filter((r) => r.length && joined))
          shape(svg, "path", { class: "limit", d: `M${run.map((i) => point(i, middle(i) + side * level(rows[i]))).join("L")}` });
    if (joined) {
      for (const run of runs.filter((r) => r.length > 1)) {
        const upper = run.map((i) => point(i, middle(i) + spread(i))), lower = run.map((i) => point(i, middle(i) - spread(i)));
        if (sigma) shape(svg, "path", { class: `band ${style}`, d: `M${upper.join("L")}L${lower.reverse().join("L")}Z` });
        shape(svg, "path", { class: `line ${style}`, d: `M${run.map((i) => point(i, ys[i])).join("L")}` });
      }
    } else if (sigma) {
      const whiskers = shown.map((i) => `M${point(i, middle(i) - spread(i))}L${point(i, middle(i) + spread(i))}`);
      shape(svg, "path", { class: `whiskers ${style}`, d: whiskers.join("") });
    }
    const alone = new Set(runs.filter((run) => run.length === 1).flat());
    for (const i of shown)
      if (!joined || alone.has(i) || (shown.length <= DOTS_UP_TO && style !== "truth"))
        shape(svg, "circle", { class: style, cx: px(xs[i]).toFixed(1), cy: py(ys[i]).toFixed(1), r: style === "truth" ? 3 : 2.4 });
  }

  // --- plots together -------------------------------------------------------------------------------------------
  function readout(chart, row) {
    const parts = chart.series.map(({ name, value, sigma }) => {
      if (row.skipped || !known(value(row))) return null;
      const number = fixed(value(row), chart.digits);
      const spread = sigma && known(sigma(row)) && !state.errors ? ` ± ${fixed(sigma(row), chart.digits)}` : "";
      const label = name === "measured" ? (state.errors ? "error " : "") : `${name} `;
      return `${label}${number}${spread}${unitAfter(chart.unit)}`;
    });
    return parts.filter(Boolean).join("  ·  ") || "no value";
  }
  function pointAt(index) {
    for (const chart of charts) {
      const x = chart.px(index);
      chart.cursor.setAttribute("x1", x ?? -9);
      chart.cursor.setAttribute("x2", x ?? -9);
      chart.readout.textContent = readout(chart, rows[index]);
    }
  }
  function nearest(chart, event) {
    const box = chart.svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * chart.svg.viewBox.baseVal.width;
    let best = state.row, least = Infinity;
    rows.forEach((row, index) => {
      const away = chart.px(index) === null || row.skipped ? Infinity : Math.abs(chart.px(index) - x);
      if (away < least) [best, least] = [index, away];
    });
    return best;
  }
  function drawAll() {
    charts.forEach(drawPlot);
    if (rows.length) pointAt(state.row);
  }
  function addPlot(chart) {
    const panel = element("div", { class: "panel plot" });
    const head = panel.appendChild(element("div", { class: "head" }));
    const unit = [chart.unit, chart.hint].filter(Boolean).join(", ");
    head.append(element("h3", {}, unit ? `${chart.title} (${unit})` : chart.title));
    chart.readout = head.appendChild(element("span", { class: "readout" }));
    chart.svg = shape(panel, "svg", { role: "img", "aria-label": `${chart.title} along the approach` });
    chart.beyond = panel.appendChild(element("p", { class: "beyond" }));
    chart.svg.addEventListener("pointermove", (event) => pointAt(nearest(chart, event)));
    chart.svg.addEventListener("pointerleave", () => pointAt(state.row));
    chart.svg.addEventListener("click", (event) => showNearest(nearest(chart, event)));
    byId("plots").append(panel);
  }
  function addSwitch(label, options, current, choose) {
    const group = element("div", { class: "switch", role: "group", "aria-label": label });
    for (const [value, text] of options) {
      const button = group.appendChild(element("button", { type: "button", "aria-pressed": value === current }, text));
      button.addEventListener("click", () => {
        for (const other of group.children) other.setAttribute("aria-pressed", other === button);
        choose(value);
        drawAll();
      });
    }
    byId("switches").append(group);
  }
  function addPlots() {
    charts.forEach(addPlot);
    if (!charts.length) return;
    if (hasErrors) addSwitch("Values", [[false, "Values"], [true, "Error against truth"]], false, (value) => (state.errors = value));
    const axis = hasTime ? "time" : "frame";
    if (hasRange) addSwitch("Horizontal axis", [axis, "range"].map((name) => [name, AXES[name].name]), axis, (value) => (state.axis = value));
    const legend = byId("plots-legend");
    legend.hidden = false;
    const guided = charts.some((chart) => chart.errors);
    if (guided) legend.append(element("span", { class: "k-measured" }, "measured"), element("span", { class: "k-band" }, "± 1 sigma"));
    if (hasLevels) legend.append(element("span", { class: "k-limit" }, "protection level"));
    if (hasErrors) legend.append(element("span", { class: "k-truth" }, "true"));
    if (rows.some(flagged)) legend.append(element("span", { class: "flagged" }, "flagged"));
    for (const side of ["left", "right"]) legend.append(element("span", { class: `series-${side}` }, `${side} line`));
    const present = new Set(rows.map(statusOf));
    for (const name of statuses.filter((status) => present.has(status))) legend.append(element("span", { class: classOf(name) }, name));
    new ResizeObserver(drawAll).observe(byId("plots"));
    drawAll();
  }

  // --- pictures -------------------------------------------------------------------------------------------------
  function words(row) {
    const metres = inside(row, "guidance", "lateral_deviation_m", "value"), widths = inside(row, "guidance", "lateral_deviation_widths", "value");
    const lateral = metres ?? widths, heading = inside(row, "guidance", "heading_error_deg", "value");
    if (!known(lateral)) return row.reason ? `No deviation (${row.reason})` : "";
    const size = known(metres) ? `${fixed(Math.abs(metres), 1)} m` : `${fixed(Math.abs(widths), 2)} runway widths`;
    const place = `${size} ${lateral >= 0 ? "right" : "left"} of the centre line`;
    return known(heading) ? `${place}, nose ${fixed(Math.abs(heading), 1)}° ${heading >= 0 ? "right" : "left"}` : place;
  }
  function cell(value, digits, unit, write) {
    return element("td", {}, known(value) ? write(value, digits) + unitAfter(unit) : "–");
  }
  function numbers(row) {
    const table = byId("frame-numbers");
    table.replaceChildren();
    if (!charts.some((chart) => chart.errors)) return; // nothing was placed in the whole run: four rows of dashes tell nothing
    const head = table.appendChild(element("thead")).appendChild(element("tr"));
    const columns = ["", "measured", "± 1 sigma", ...(hasLevels ? ["protection"] : []), ...(hasErrors ? ["true", "error"] : [])];
    for (const name of columns) head.append(element("th", { scope: "col" }, name));
    const body = table.appendChild(element("tbody"));
    for (const { key, title, unit, digits, sides, level } of GUIDANCE) {
      const line = body.appendChild(element("tr"));
      const write = sides ? signed : fixed;
      line.append(element("th", { scope: "row" }, title), cell(inside(row, "guidance", key, "value"), digits, unit, write));
      line.append(cell(inside(row, "guidance", key, "sigma"), digits, unit, fixed));
      if (hasLevels) line.append(cell(level && inside(row, "protection", level), digits, unit, fixed));
      if (hasErrors) line.append(cell(inside(row, "truth", key), digits, unit, write), cell(inside(row, "errors", key), digits, unit, signed));
    }
  }
  function showPicture(number) {
    const picture = pictures[number], row = rows[picture.record];
    state.row = picture.record;
    byId("slider").value = number;
    byId("slider").setAttribute("aria-valuetext", row.file);
    byId("hazy").src = `data:image/jpeg;base64,${picture.hazy}`;
    byId("hazy").alt = `Camera image ${row.file}`;
    byId("marked").src = `data:image/jpeg;base64,${picture.marked}`;
    byId("marked").alt = `Dehazed ${row.file} with the lines found`;
    byId("frame-status").textContent = row.status;
    byId("frame-status").className = `pill ${classOf(statusOf(row))}`;
    const time = known(row.time_s) ? ` · ${Number(row.time_s.toFixed(6))} s` : "";
    byId("frame-name").textContent = `${row.file}${time} · mode ${row.mode}${row.track ? ` · ${row.track}` : ""} · picture ${number + 1} of ${pictures.length}`;
    byId("frame-words").textContent = [flagged(row) ? `Flagged: ${row.flags.join("; ")}.` : "", words(row)].filter(Boolean).join(" ");
    numbers(row);
    const lines = ["left", "right"].map((side) => `${side} line: ${row[side].used ?? 0} of ${row[side].points} points used`);
    const speed = known(row.seconds) ? ` · computed in ${fixed(row.seconds * 1000, 0)} ms` : "";
    byId("frame-points").textContent = lines.join(" · ") + speed;
    if (charts.length) pointAt(state.row);
  }
  function showNearest(index) {
    if (!pictures.length) return;
    const away = pictures.map((picture) => Math.abs(picture.record - index));
    showPicture(away.indexOf(Math.min(...away)));
  }
  function addPictures() {
    if (!pictures.length) return;
    byId("viewer-section").hidden = false;
    const slider = byId("slider");
    slider.max = pictures.length - 1;
    const step = (by) => showPicture(Math.min(Math.max(Number(slider.value) + by, 0), pictures.length - 1));
    slider.addEventListener("input", () => step(0));
    byId("back").addEventListener("click", () => step(-1));
    byId("next").addEventListener("click", () => step(1));
    const ok = pictures.map((_, number) => number).filter((number) => rows[pictures[number].record].seen === "both lines");
    showPicture(ok[Math.floor(ok.length / 2)] ?? 0); // in the first ones the deck is mostly a speck
  }

  addPlots();
  addPictures();
})();
