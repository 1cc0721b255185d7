// Axes of the plot: from values to places, and where the ticks are.
"use strict";

/** A linear or logarithmic scale of values onto [from, to] that holds all of them. */
function scaleOf(values, logarithmic, from, to) {
  return logarithmic ? logScale(values, from, to) : linearScale(values, from, to);
}

function logScale(values, from, to) {
  const known = values.filter((value) => value > 0);
  let low = Math.log10(known.length ? Math.min(...known) : 0.1);
  let high = Math.log10(known.length ? Math.max(...known) : 10);
  const margin = Math.max(0.04 * (high - low), 0.1);
  [low, high] = [low - margin, high + margin];
  const place = (value) => {
    const share = value > 0 ? (Math.log10(value) - low) / (high - low) : 0;
    return from + Math.max(0, share) * (to - from);
  };
  return { place, ticks: logTicks(low, high), logarithmic: true };
}

/** Powers of ten; with few of them also their multiples by 2 and 5; with very many only some. */
function logTicks(low, high) {
  const steps = high - low < 2.5 ? [1, 2, 5] : [1];
  const every = Math.max(1, Math.ceil((high - low) / 8));
  const ticks = [];
  for (let power = Math.floor(low); power <= high; power += 1) {
    if (power % every !== 0) continue;
    for (const step of steps) ticks.push(Number(`${step}e${power}`));
  }
  return ticks.filter((tick) => Math.log10(tick) >= low && Math.log10(tick) <= high);
}

function linearScale(values, from, to) {
  let low = Math.min(...values, Infinity), high = Math.max(...values, -Infinity);
  if (!(low <= high)) [low, high] = [0, 1];
  const margin = 0.05 * (high - low || Math.abs(high) || 1);
  const least = low >= 0 && low < 0.3 * high ? 0 : low - margin;
  high += margin;
  const place = (value) => from + ((value - least) / (high - least)) * (to - from);
  return { place, ticks: linearTicks(least, high), logarithmic: false };
}

/** Between four and eight round numbers. */
function linearTicks(low, high) {
  const rough = (high - low) / 7;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((s) => s * power).find((s) => s >= rough);
  const ticks = [];
  for (let n = Math.ceil(low / step); n * step <= high; n += 1) ticks.push(Number((n * step).toPrecision(12)));
  return ticks;
}
