// The figures' markers and broken lines, by matplotlib's names for them.
"use strict";

const DASHES = { "-": "none", "--": "6 3", "-.": "7 2.5 1.5 2.5", ":": "1.5 2.5" };

/** Corners of a regular polygon or, with a second radius between them, of a star. */
function corners(count, turn = -90, radius = 1, inner = null) {
  const every = inner === null ? 1 : 2;
  return Array.from({ length: count * every }, (_, n) => {
    const angle = ((turn + (360 * n) / (count * every)) * Math.PI) / 180;
    const r = n % every ? inner : radius;
    return [r * Math.cos(angle), r * Math.sin(angle)];
  });
}

const PLUS = [
  [-0.35, -1], [0.35, -1], [0.35, -0.35], [1, -0.35], [1, 0.35], [0.35, 0.35],
  [0.35, 1], [-0.35, 1], [-0.35, 0.35], [-1, 0.35], [-1, -0.35], [-0.35, -0.35],
];
const turned = (points, degrees) => {
  const [c, s] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
  return points.map(([x, y]) => [c * x - s * y, s * x + c * y]);
};

const thinned = (points) => points.map(([x, y]) => [x, y].map((v) => (Math.abs(v) < 1 ? v * 0.4 : v)));

/** Three thin arms, the first downwards: matplotlib's "1". */
const THIN = 0.14;
const ARM = [[THIN, 1], [-THIN, 1], [-THIN, THIN * Math.tan(Math.PI / 6)]];
const ARMS = [0, 120, 240].flatMap((degrees) => turned(ARM, degrees));

const MARKERS = {
  o: null,
  s: corners(4, 45, 1.15), D: corners(4, 0, 1.15), d: corners(4).map(([x, y]) => [0.62 * x, 1.2 * y]),
  "^": corners(3, -90, 1.2), v: corners(3, 90, 1.2), "<": corners(3, 180, 1.2), ">": corners(3, 0, 1.2),
  p: corners(5), h: corners(6), H: corners(6, 0), 8: corners(8, 22.5), "*": corners(5, -90, 1.3, 0.55),
  P: PLUS, X: turned(PLUS, 45), "+": thinned(PLUS), x: turned(thinned(PLUS), 45),
  1: ARMS, 2: turned(ARMS, 180), 3: turned(ARMS, 90), 4: turned(ARMS, -90),
  "|": [[-THIN, -1], [THIN, -1], [THIN, 1], [-THIN, 1]], _: [[-1, -THIN], [1, -THIN], [1, THIN], [-1, THIN]],
};

/** A marker of a radius in pixels around the origin; a circle where the name is not known. */
function marker(name, radius) {
  if (!MARKERS[name]) return drawn("circle", { r: radius });
  const points = MARKERS[name].map((corner) => corner.map((v) => (v * radius).toFixed(2)).join());
  return drawn("polygon", { points: points.join(" ") });
}
