// The camera of the viewer: it turns around a point, z upwards, and looks at it.
"use strict";

const FOCAL = 2.2; // of a view whose height is 2
const START = { azimuth: -60, elevation: 32 };

/** Where the camera stands around the lower share of a cloud's box; lengths in the cloud's unit. */
function startingCamera(low, whole, share) {
  const extent = [whole[0], whole[1], whole[2] * share];
  const radius = 0.5 * Math.hypot(...extent) || 1;
  return {
    ...START,
    radius,
    away: 2.0 * radius,
    target: low.map((value, axis) => value + extent[axis] / 2),
  };
}

/** Rows of the rotation: to the right, upwards, and towards the viewer. */
function axesOfView({ azimuth, elevation }) {
  const [ca, sa] = cosSin(azimuth), [ce, se] = cosSin(elevation);
  return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]];
}

function cosSin(degrees) {
  const angle = (degrees * Math.PI) / 180;
  return [Math.cos(angle), Math.sin(angle)];
}

function turn(camera, across, upwards) {
  camera.azimuth -= across;
  camera.elevation = Math.max(-89, Math.min(89, camera.elevation + upwards));
}

function zoom(camera, factor) {
  camera.away = Math.max(0.05 * camera.radius, Math.min(20 * camera.radius, camera.away * factor));
}

/** Move the camera and what it looks at, in shares of what it sees upwards. */
function shift(camera, across, upwards) {
  const [right, up] = axesOfView(camera);
  const seen = (2 * camera.away) / FOCAL;
  camera.target = camera.target.map((v, n) => v - seen * (across * right[n] - upwards * up[n]));
}

/** Drag, wheel, touch and keys on a canvas; `redraw` is called after each change. */
function steer(canvas, camera, redraw) {
  const fingers = new Map();
  const changed = (event) => {
    event.preventDefault();
    redraw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    drag(camera(), fingers, event, canvas.clientHeight || 1);
    changed(event);
  });
  canvas.addEventListener("wheel", (event) => {
    // A page that is scrolled past must not stop here: only where one has clicked, or pinches.
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    zoom(camera(), Math.exp(0.0015 * event.deltaY));
    changed(event);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (pressed(camera(), event)) changed(event);
  });
}

function drag(camera, fingers, event, height) {
  const before = [...fingers.values()];
  const [x, y] = fingers.get(event.pointerId);
  const [across, upwards] = [event.clientX - x, event.clientY - y];
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fingers.size === 1 && !event.shiftKey) return turn(camera, (300 * across) / height, (300 * upwards) / height);
  shift(camera, across / height / fingers.size, upwards / height / fingers.size);
  if (fingers.size === 2) zoom(camera, apart(before) / Math.max(1, apart([...fingers.values()])));
}

function apart([[ax, ay], [bx, by]]) {
  return Math.hypot(ax - bx, ay - by);
}

/** Whether the key means something to the camera. */
function pressed(camera, { key, shiftKey }) {
  const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  if (arrows[key]) {
    const [across, upwards] = arrows[key];
    if (shiftKey) shift(camera, -0.05 * across, -0.05 * upwards);
    else turn(camera, 5 * across, 5 * upwards);
  } else if (key === "+" || key === "=") zoom(camera, 1 / 1.15);
  else if (key === "-" || key === "−") zoom(camera, 1.15);
  else return false;
  return true;
}
