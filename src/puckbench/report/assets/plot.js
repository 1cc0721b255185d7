// The interactive plot: medians and quartiles of a metric against bits per point.
"use strict";

const MARGIN = { right: 14, top: 30, bottom: 46 };
const LINE = 14; // pixels from one line of a label to the next
const CHARACTER = 6.4; // pixels of a character, on average
const MARKER_RADIUS = 4.6;
const REACH = 28; // pixels from a marker within which pointing means it

function setUpPlot(data, host) {
  new Plot(data, host);
}

class Plot {
  constructor(data, host) {
    this.data = data;
    this.state = {
      dataset: data.datasets.length > 1 ? "" : data.datasets[0].name, // "" stands for all of them
      metric: (data.metrics.find((m) => m.name === "cd_plane") ?? data.metrics[0]).name,
      logX: true, logY: true, spread: true,
      codecs: new Set(data.codecs.map((codec) => codec.name)),
    };
    this.state.logY = this.isLogarithmic();
    this.svg = drawn("svg", { class: "plot", role: "group", onpointermove: (e) => this.point(e),
      onpointerdown: (e) => this.point(e), onpointerleave: () => this.hide(), onkeydown: (e) => this.move(e) });
    this.tip = element("div", { class: "tip", hidden: true, "aria-hidden": true });
    this.numbers = element("div", { class: "scroll", tabindex: 0 });
    const folded = element("details", {}, element("summary", {}, "The numbers of this plot"), this.numbers);
    this.frame = element("div", { class: "frame" }, this.svg, this.tip);
    host.append(this.controls(), this.frame, folded);
    new ResizeObserver(() => this.width !== this.frame.clientWidth && this.draw()).observe(this.frame);
    this.draw();
  }

  get metric() {
    return this.data.metrics.find((metric) => metric.name === this.state.metric);
  }

  isLogarithmic() {
    return !["dB", ""].includes(this.metric.unit);
  }

  change(values) {
    Object.assign(this.state, values);
    this.draw();
  }

  controls() {
    const { data, state } = this;
    const datasets = data.datasets.map(({ name, title }) => [name, title]);
    if (datasets.length > 1) datasets.unshift(["", "All, side by side"]);
    const metrics = data.metrics.map((m) => [m.name, labelOf(m), m.group]);
    const scales = element("span", { class: "boxes" });
    const logY = box("logarithmic upwards", state.logY, (logY) => this.change({ logY }));
    scales.append(logY, box("logarithmic across", state.logX, (logX) => this.change({ logX })),
      box("quartiles", state.spread, (spread) => this.change({ spread })));
    const chosenMetric = (metric) => {
      this.state.metric = metric;
      logY.firstChild.checked = this.isLogarithmic();
      this.change({ logY: this.isLogarithmic() });
    };
    return element("div", { class: "controls" },
      choice("Data set", datasets, state.dataset, (dataset) => this.change({ dataset })),
      choice("Metric", metrics, state.metric, chosenMetric), scales, this.legend());
  }

  legend() {
    const boxes = this.data.codecs.map((codec) => {
      const toggle = (shown) => {
        this.state.codecs[shown ? "add" : "delete"](codec.name);
        this.draw();
      };
      return box([swatch(codec), codec.title], true, toggle);
    });
    return element("fieldset", { class: "legend" }, element("legend", {}, "Codecs"), ...boxes);
  }

  /** Cells that are shown: of a data set, or of all that are. */
  cells(dataset = this.state.dataset) {
    const { metric, codecs } = this.state;
    return this.data.cells.filter((cell) => codecs.has(cell.codec) && metric in cell.values
      && (!dataset || cell.dataset === dataset));
  }

  draw() {
    this.hide();
    this.width = this.frame.clientWidth;
    const width = Math.max(300, this.width);
    const names = this.data.datasets.filter(({ name }) => !this.state.dataset || name === this.state.dataset);
    const columns = names.length > 1 && width >= 640 ? 2 : 1;
    const panel = { width: width / columns, height: Math.round(columns > 1 ? 300 : Math.min(440, 0.62 * width + 90)) };
    const height = panel.height * Math.ceil(names.length / columns);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.setAttribute("aria-label", `${this.metric.words} against bits per point`);
    this.svg.replaceChildren();
    this.points = [];
    const labels = new Map(names.map(({ frame }) => [this.metric.units[frame], this.axisLabel(frame, panel)]));
    panel.left = 48 + LINE * Math.max(...[...labels.values()].map((lines) => lines.length));
    names.forEach((dataset, n) => {
      const unit = this.metric.units[dataset.frame];
      this.drawPanel(dataset, this.scales(panel, unit), { ...panel, label: labels.get(unit) },
        [(n % columns) * panel.width, Math.floor(n / columns) * panel.height]);
    });
    this.points[0]?.node.setAttribute("tabindex", 0);
    this.numbers.replaceChildren(this.table());
  }

  axisLabel(frame, panel) {
    const { words, units } = this.metric;
    return wrapped(labelOf({ words, unit: units[frame] }), (panel.height - 50) / CHARACTER);
  }

  /** The same axes for all panels, but for values in grid units and in metres. */
  scales(panel, unit) {
    const { metric, spread, logX, logY } = this.state;
    const cells = this.cells();
    const inUnit = cells.filter((cell) => this.unitOf(cell) === unit);
    const values = (from, name) => from.flatMap(({ values }) => (spread ? values[name] : [values[name][1]]));
    return {
      x: scaleOf(values(cells, "bpp"), logX, panel.left, panel.width - MARGIN.right),
      y: scaleOf(values(inUnit, metric), logY, panel.height - MARGIN.bottom, MARGIN.top),
    };
  }

  unitOf({ dataset }) {
    return this.metric.units[this.data.datasets.find(({ name }) => name === dataset).frame];
  }

  drawPanel(dataset, { x, y }, panel, [left, top]) {
    const group = drawn("g", { transform: `translate(${left} ${top})` });
    this.svg.append(group);
    group.append(...axesOf(x, y, panel), ...labelsOf(panel, dataset.title));
    const cells = this.cells(dataset.name);
    if (!cells.length) group.append(drawn("text", { class: "none", x: panel.width / 2, y: panel.height / 2 }, "no values"));
    for (const codec of this.data.codecs) {
      const own = cells.filter((cell) => cell.codec === codec.name);
      if (own.length) this.drawCurve(group, codec, own, x, y, [left, top]);
    }
  }

  drawCurve(group, codec, cells, x, y, [left, top]) {
    const curve = drawn("g", { class: "curve", "--codec": codec.colour, "data-codec": codec.name });
    group.append(curve);
    const places = cells.map(({ values }) => [x.place(values.bpp[1]), y.place(values[this.state.metric][1])]);
    const line = places.map((place) => place.map((v) => v.toFixed(1)).join()).join(" ");
    curve.append(drawn("polyline", { points: line, "stroke-dasharray": DASHES[codec.line] ?? "none" }));
    if (this.state.spread) curve.append(...cells.flatMap((cell, n) => this.bars(cell, x, y, places[n])));
    const start = this.points.length;
    cells.forEach((cell, n) => {
      const node = this.pointNode(codec, cell, places[n], y.logarithmic);
      curve.append(node);
      this.points.push({ node, codec, cell, start, place: [left + places[n][0], top + places[n][1]] });
    });
  }

  bars({ values }, x, y, [atX, atY]) {
    const [left, right] = [values.bpp[0], values.bpp[2]].map(x.place);
    const [low, high] = [values[this.state.metric][0], values[this.state.metric][2]].map(y.place);
    return [
      drawn("line", { class: "bar", x1: atX, x2: atX, y1: low, y2: high }),
      drawn("line", { class: "bar", x1: left, x2: right, y1: atY, y2: atY }),
    ];
  }

  pointNode(codec, cell, [x, y], logarithmic) {
    const zero = logarithmic && cell.values[this.state.metric][1] <= 0;
    const node = drawn("g", { class: zero ? "point zero" : "point", role: "img", tabindex: -1,
      transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`, "aria-label": this.words(codec, cell).join(", ") });
    node.append(marker(codec.marker, MARKER_RADIUS));
    node.addEventListener("focus", () => this.show(this.points.find((point) => point.node === node)));
    node.addEventListener("blur", () => this.hide());
    return node;
  }

  /** What is said of a point: codec and rate, bits, value, how many clouds. */
  words(codec, { dataset, rate, clouds, values }) {
    const title = this.data.datasets.find(({ name }) => name === dataset).title;
    return [
      `${codec.title}, ${rate}`,
      `${title}, ${clouds} ${clouds === 1 ? "cloud" : "clouds"}`,
      `${spreadText(values.bpp)} bpp`,
      `${this.metric.words}: ${spreadText(values[this.metric.name])} ${this.unitOf({ dataset })}`.trim(),
    ];
  }

  point(event) {
    const bounds = this.svg.getBoundingClientRect();
    const factor = this.svg.viewBox.baseVal.width / bounds.width;
    const [x, y] = [(event.clientX - bounds.left) * factor, (event.clientY - bounds.top) * factor];
    const distance = ({ place }) => Math.hypot(place[0] - x, place[1] - y);
    const nearest = this.points.reduce((a, b) => (a && distance(a) <= distance(b) ? a : b), null);
    if (nearest && distance(nearest) <= REACH) this.show(nearest);
    else this.hide();
  }

  show(point) {
    this.hide();
    if (!point) return;
    point.node.classList.add("shown");
    const [title, ...lines] = this.words(point.codec, point.cell);
    this.tip.replaceChildren(element("strong", {}, title), ...lines.map((line) => element("div", {}, line)));
    this.tip.hidden = false;
    const width = this.svg.viewBox.baseVal.width;
    const share = this.frame.clientWidth / width;
    const left = Math.min(point.place[0] * share + 14, this.frame.clientWidth - this.tip.offsetWidth - 4);
    this.tip.style.left = `${Math.max(0, left)}px`;
    this.tip.style.top = `${point.place[1] * share + 14}px`;
  }

  hide() {
    this.tip.hidden = true;
    this.svg.querySelector(".shown")?.classList.remove("shown");
  }

  /** Left and right go along a curve, up and down to the next codec or panel. */
  move(event) {
    const at = this.points.findIndex(({ node }) => node === document.activeElement);
    const steps = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: "next", ArrowUp: "last" };
    const step = steps[event.key];
    if (at < 0 || step === undefined) return;
    event.preventDefault();
    const starts = [...new Set(this.points.map(({ start }) => start))];
    const curve = starts.indexOf(this.points[at].start);
    const along = at - starts[curve];
    let to = at + step;
    if (typeof step === "string") {
      const other = (curve + (step === "next" ? 1 : starts.length - 1)) % starts.length;
      to = Math.min(starts[other] + along, (starts[other + 1] ?? this.points.length) - 1);
    }
    if (!this.points[to]) return;
    this.points[at].node.setAttribute("tabindex", -1);
    this.points[to].node.setAttribute("tabindex", 0);
    this.points[to].node.focus();
  }

  table() {
    const heads = ["Data set", "Codec", "Rate", "Clouds", "Bits per point", "quartiles", labelOf(this.metric), "quartiles"];
    const title = (list, wanted) => list.find(({ name }) => name === wanted).title;
    const rows = this.cells().map(({ dataset, codec, rate, clouds, values }) => {
      const both = [values.bpp, values[this.metric.name]];
      const cells = both.flatMap(([q1, median, q3]) => [numberText(median), `${numberText(q1)} – ${numberText(q3)}`]);
      return element("tr", {}, ...[title(this.data.datasets, dataset), title(this.data.codecs, codec), rate, clouds, ...cells].map((text) => element("td", {}, text)));
    });
    const head = element("tr", {}, ...heads.map((text) => element("th", { scope: "col" }, text)));
    return element("table", {}, element("thead", {}, head), element("tbody", {}, ...rows));
  }
}

function spreadText([q1, median, q3]) {
  return q1 === q3 ? numberText(median) : `${numberText(median)} (${numberText(q1)} – ${numberText(q3)})`;
}

/** A codec's line and marker, for the legend. */
function swatch(codec) {
  const line = drawn("line", { x1: 0, x2: 30, y1: 8, y2: 8, "stroke-dasharray": DASHES[codec.line] ?? "none" });
  const symbol = drawn("g", { class: "point", transform: "translate(15 8)" }, marker(codec.marker, MARKER_RADIUS));
  return drawn("svg", { class: "swatch curve", width: 30, height: 16, "--codec": codec.colour, "aria-hidden": true }, line, symbol);
}

function axesOf(x, y, panel) {
  const [left, right, low, top] = [panel.left, panel.width - MARGIN.right, panel.height - MARGIN.bottom, MARGIN.top];
  const across = x.ticks.flatMap((tick) => [
    drawn("line", { class: "grid", x1: x.place(tick), x2: x.place(tick), y1: low, y2: top }),
    drawn("text", { class: "tick", x: x.place(tick), y: low + 16, "text-anchor": "middle" }, numberText(tick)),
  ]);
  const upwards = y.ticks.flatMap((tick) => [
    drawn("line", { class: "grid", x1: left, x2: right, y1: y.place(tick), y2: y.place(tick) }),
    drawn("text", { class: "tick", x: left - 6, y: y.place(tick) + 4, "text-anchor": "end" }, numberText(tick)),
  ]);
  const border = drawn("rect", { class: "border", x: left, y: top, width: right - left, height: low - top });
  return [...across, ...upwards, border];
}

function labelsOf(panel, title) {
  const middle = [(panel.left + panel.width - MARGIN.right) / 2, (MARGIN.top + panel.height - MARGIN.bottom) / 2];
  const upwards = panel.label.map((line, n) =>
    drawn("text", { class: "label", transform: `translate(${LINE * (n + 1)} ${middle[1]}) rotate(-90)` }, line));
  return [
    drawn("text", { class: "title", x: middle[0], y: 19 }, title),
    drawn("text", { class: "label", x: middle[0], y: panel.height - 10 }, "Bits per point (bpp)"),
    ...upwards,
  ];
}

function labelOf({ words, unit }) {
  return unit ? `${words} (${unit.replaceAll(" ", "\u00a0")})` : words; // a unit stays on one line
}

/** Lines of limited length, broken between words. */
function wrapped(text, most) {
  const lines = [""];
  for (const word of text.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (longer.length <= most || !lines.at(-1)) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}
