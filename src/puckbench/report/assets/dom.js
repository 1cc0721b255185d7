// Small helpers of all scripts: elements, choices, numbers in words, the page's data.
"use strict";

const SVG = "http://www.w3.org/2000/svg"; // the name of the format; nothing is fetched from there

/** An HTML element; attributes "onclick" and so on are listeners, children are nodes or text. */
function element(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

/** An SVG element, as `element`. */
function drawn(name, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, name), attributes, children);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key.startsWith("--")) node.style.setProperty(key, value);
    else if (value !== null && value !== false) node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children);
  return node;
}

/** The data that stand in the page under this name; null where there are none. */
function dataOf(name) {
  const holder = document.getElementById(`data-${name}`);
  return holder ? JSON.parse(holder.textContent) : null;
}

/** A labelled list to choose one of: options are [value, text] or [value, text, group]. */
function choice(label, options, chosen, onchange) {
  const select = element("select", { onchange: () => onchange(select.value) });
  const groups = new Map();
  for (const [value, text, group] of options) {
    const option = element("option", { value }, text);
    if (!group) select.append(option);
    else {
      if (!groups.has(group)) {
        groups.set(group, element("optgroup", { label: group }));
        select.append(groups.get(group));
      }
      groups.get(group).append(option);
    }
  }
  select.value = chosen;
  return element("label", {}, element("span", {}, label), select);
}

/** A labelled box to tick. */
function box(label, checked, onchange) {
  const input = element("input", { type: "checkbox", onchange: () => onchange(input.checked) });
  input.checked = checked;
  return element("label", { class: "box" }, input, ...[label].flat());
}

/** A labelled slider from 0 to 1. */
function slider(label, value, oninput) {
  const input = element("input", {
    type: "range", min: 0, max: 1, step: 0.01, value, oninput: () => oninput(Number(input.value)),
  });
  return element("label", {}, element("span", {}, label), input);
}

/** A number to four significant digits, with powers of ten where it would be long. */
function numberText(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-4) {
    const [digits, power] = value.toExponential(2).split("e");
    return `${Number(digits)}·10${raised(Number(power))}`;
  }
  return size >= 1e4 ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(4)));
}

function raised(power) {
  return [...String(power)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
}
