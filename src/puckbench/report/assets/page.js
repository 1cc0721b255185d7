// What the page does when it is opened: tables, plot, viewer, light and dark, large figures.
"use strict";

function setUpTheme() {
  const root = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)");
  const show = (scheme) => {
    root.dataset.scheme = scheme; // colours alone can tell the scheme in a style sheet, filters cannot
  };
  const follow = () => root.style.colorScheme || show(system.matches ? "dark" : "light");
  const toggle = () => {
    root.style.colorScheme = root.dataset.scheme === "dark" ? "light" : "dark";
    show(root.style.colorScheme);
  };
  follow();
  system.addEventListener("change", follow);
  document.querySelector("header nav").append(element("button", { type: "button", onclick: toggle }, "Light / dark"));
}

/** A figure fills the window when it is clicked. */
function setUpFigures() {
  const dialog = element("dialog", { class: "large", onclick: () => dialog.close() });
  document.body.append(dialog);
  for (const picture of document.querySelectorAll("#figures img")) {
    const open = () => {
      dialog.replaceChildren(picture.cloneNode());
      dialog.showModal();
    };
    const button = element("button", { type: "button", class: "enlarge", title: "Show large", onclick: open });
    picture.replaceWith(button);
    button.append(picture);
  }
}

function setUp(name, start) {
  const data = dataOf(name === "plot" ? "curves" : "clouds");
  const host = document.getElementById(name);
  if (data && host) start(data, host);
}

setUpTheme();
setUpTables();
setUpFigures();
setUp("plot", setUpPlot);
setUp("viewer", setUpViewer);
document.documentElement.dataset.ready = "yes";
