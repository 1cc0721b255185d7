// The viewer: an example's original, what a codec made of it, and where that lies off.
"use strict";

const SIZES = [1, 7]; // pixels of a point, from the slider's one end to the other
const NOT_ABOVE = 0.8; // share of a room's height that is shown at first, so that one sees inside

function setUpViewer(data, host) {
  new Viewer(data, host);
}

class Viewer {
  constructor(data, host) {
    [this.data, this.host, host.viewer] = [data, host, this];
    this.state = { size: 0.4, height: 1, front: 0 };
    this.panes = ["Original", "Decoded", "Error"].map((name) => this.pane(name));
    this.bars = { height: element("div", { class: "colourbar" }), error: element("div", { class: "colourbar" }) };
    this.controls = element("div", { class: "controls" });
    const panes = element("div", { class: "panes" }, ...this.panes.map(({ figure }) => figure));
    host.append(this.controls, panes, element("div", { class: "colourbars" }, this.bars.height, this.bars.error));
    new ResizeObserver(() => this.redraw()).observe(panes);
    const { example, codec, rate } = data.start;
    this.decoded = { codec, rate };
    this.open(example);
  }

  pane(name) {
    const canvas = element("canvas", { tabindex: 0, role: "img" });
    const title = element("strong", {}, name), words = element("span");
    const figure = element("figure", { class: "pane" }, canvas, element("figcaption", {}, title, " ", words));
    steer(canvas, () => this.camera, () => this.redraw());
    return { name, canvas, words, figure, drawer: drawerOf(canvas) };
  }

  /** Show another example, from the start. */
  open(index) {
    this.index = index;
    this.example = this.data.examples[index];
    this.original = unpacked(this.example.original);
    this.reset();
    this.decoded = this.decodedOf(this.decoded?.codec, this.decoded?.rate);
    this.load();
  }

  reset() {
    const { low, extent } = this.example.original;
    Object.assign(this.state, this.example.opened ? { height: NOT_ABOVE, front: 0.25 } : { height: 1, front: 0 });
    this.camera = startingCamera(low, extent, this.state.height);
  }

  /** The decoded cloud of a codec at a rate; else of the codec in the middle, else the first one. */
  decodedOf(codec, rate) {
    const all = this.example.decoded;
    const own = all.filter((item) => item.codec === codec);
    return own.find((item) => item.rate === rate) ?? own[Math.floor(own.length / 2)] ?? all[Math.floor(all.length / 2)];
  }

  choose(codec, rate) {
    this.decoded = this.decodedOf(codec, rate);
    this.load();
  }

  load() {
    const { low, extent } = this.example.original;
    const decoded = this.decoded && unpacked(this.decoded);
    const height = (cloud) => coloursOf(cloud, this.data.maps.height, (n) => (cloud.xyz[3 * n + 2] - low[2]) / (extent[2] || 1));
    this.panes[0].drawer.load(height(this.original));
    if (decoded) {
      this.panes[1].drawer.load(height(decoded));
      this.panes[2].drawer.load(coloursOf(decoded, this.data.maps.error, (n) => decoded.error[n] / 255));
    }
    this.say();
    this.drawControls();
    this.drawBars();
    this.redraw();
  }

  say() {
    const { original, unit } = this.example;
    const texts = [countText(original)];
    if (this.decoded) {
      const { codec, rate, bpp, quantiles } = this.decoded;
      const title = this.look(codec).title;
      texts.push(`${title}, ${rate}${bpp ? `, ${numberText(bpp)} bpp` : ""}: ${countText(this.decoded)}`);
      const [half, most] = quantiles.map((value) => lengthText(value, unit));
      texts.push(`half of the points within ${half}, 95 % within ${most}`);
    }
    this.panes.forEach(({ name, canvas, words, figure }, n) => {
      figure.hidden = n >= texts.length;
      words.textContent = texts[n] ?? "";
      canvas.setAttribute("aria-label", `${name}: ${this.example.title}, ${texts[n]}`);
    });
  }

  look(codec) {
    return this.data.codecs.find(({ name }) => name === codec);
  }

  drawControls() {
    const { data, state, decoded } = this;
    const examples = data.examples.map(({ title }, n) => [String(n), title]);
    const present = data.codecs.filter(({ name }) => this.example.decoded.some((item) => item.codec === name));
    const rates = this.example.decoded.filter((item) => item.codec === decoded?.codec);
    const focused = [...this.controls.querySelectorAll("select, button")].indexOf(document.activeElement);
    const set = (name) => (value) => {
      state[name] = value;
      this.redraw();
    };
    this.controls.replaceChildren(
      choice("Cloud", examples, String(this.index), (value) => this.open(Number(value))),
      choice("Codec", present.map(({ name, title }) => [name, title]), decoded?.codec, (codec) => this.choose(codec)),
      choice("Rate", rates.map(({ rate, bpp }) => [rate, bpp ? `${rate} (${numberText(bpp)} bpp)` : rate]),
        decoded?.rate, (rate) => this.choose(decoded.codec, rate)),
      slider("Points", state.size, set("size")),
      slider("Show up to height", state.height, set("height")),
      slider("Cut away in front", state.front, set("front")),
      element("button", { type: "button", onclick: () => { this.reset(); this.load(); } }, "Start again"),
    );
    this.controls.querySelectorAll("select, button")[focused]?.focus();
  }

  drawBars() {
    const { original, ranges, unit } = this.example;
    const [lowest, highest] = ranges[this.decoded?.codec] ?? [0, 0];
    const above = (share) => lengthText(share * original.extent[2], unit);
    colourBar(this.bars.height, this.data.maps.height, "Height", [0, 0.5, 1].map((share) => [share, above(share)]));
    const error = (share) => lengthText(lowest * (highest / lowest) ** share, unit);
    const ticks = highest ? [[0, `≤ ${error(0)}`], [0.5, error(0.5)], [1, `≥ ${error(1)}`]] : [[0, "0"]];
    colourBar(this.bars.error, this.data.maps.error, "Distance to the original", ticks);
  }

  redraw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = undefined;
      this.panes.forEach(({ canvas, drawer }) => this.drawPane(canvas, drawer));
    });
  }

  drawPane(canvas, drawer) {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const { camera, state } = this;
    const { low, extent } = this.example.original;
    drawer.draw({
      axes: axesOfView(camera), target: camera.target, away: camera.away, radius: camera.radius,
      size: ratio * (SIZES[0] + state.size * (SIZES[1] - SIZES[0])),
      top: state.height >= 1 ? 1e30 : low[2] + state.height * extent[2],
      front: state.front ? camera.away + camera.radius * (2 * state.front - 1) : 0,
    });
  }
}

/** Coordinates and errors of a cloud as they were before they were put into text. */
function unpacked({ points, low, extent, xyz, error }) {
  const steps = new Uint16Array(bytesOf(xyz).buffer);
  const places = new Float32Array(3 * points);
  for (let n = 0; n < places.length; n += 1) places[n] = low[n % 3] + (steps[n] / 65535) * extent[n % 3];
  return { xyz: places, error: error && bytesOf(error) };
}

function bytesOf(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

/** The cloud with a colour for each point, from the map at a share between 0 and 1. */
function coloursOf({ xyz }, map, share) {
  const stops = map.map((text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16)));
  const colours = new Uint8Array(xyz.length);
  for (let n = 0; n < xyz.length / 3; n += 1) {
    const at = Math.round(Math.max(0, Math.min(1, share(n))) * (stops.length - 1));
    colours.set(stops[at], 3 * n);
  }
  return { xyz, colours };
}

function colourBar(host, map, title, ticks) {
  const strip = element("div", { class: "strip" });
  strip.style.background = `linear-gradient(to right, ${map.join(", ")})`;
  const labels = ticks.map(([share, text]) => {
    const label = element("span", {}, text);
    label.style.left = `${100 * share}%`;
    return label;
  });
  host.replaceChildren(element("div", {}, title), strip, element("div", { class: "ticks" }, ...labels));
}

function countText({ points, total }) {
  const all = `${total.toLocaleString("en")} points`;
  return points < total ? `${all}, ${points.toLocaleString("en")} of them shown` : all;
}

/** A length: metres as m, cm, mm or µm, whichever is short. */
function lengthText(value, unit) {
  if (unit !== "m") return `${Number(value.toPrecision(2))} ${unit}`;
  const [factor, name] = [[1, "m"], [1e2, "cm"], [1e3, "mm"], [1e6, "µm"]].find(([f]) => value * f >= 0.995) ?? [1e6, "µm"];
  return value ? `${Number((value * factor).toPrecision(2))} ${name}` : "0";
}
