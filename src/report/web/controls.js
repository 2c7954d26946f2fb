// The bar and the legends above the views, and what keys do in a view.

const PRESETS = { 1: "behind", 2: "above", 3: "camera" };

function connectControls(viewer) {
  const { box, classes, shown } = viewer;
  const select = box.querySelector("select");
  select.addEventListener("change", () => viewer.open(Number(select.value)));
  box.querySelector(".previous").addEventListener("click", () => viewer.step(-1));
  box.querySelector(".next").addEventListener("click", () => viewer.step(1));
  for (const button of all("[data-mode]", box)) {
    button.addEventListener("click", () => viewer.set({ mode: button.dataset.mode }));
  }
  for (const button of all("[data-view]", box)) {
    button.addEventListener("click", () => viewer.look(button.dataset.view));
  }
  const beyond = box.querySelector(".beyond input");
  beyond.addEventListener("change", () => viewer.set({ beyond: beyond.checked }));
  const entries = classes.names.map((name, n) => ({ name, color: classes.colors[n] }));
  fillLegend(box.querySelector(".legend.classes"), entries, shown.classes, () => viewer.rebuild());
  fillLegend(box.querySelector(".legend.errors"), ERRORS, shown.errors, () => viewer.rebuild());
}

function nameScenes(select, titles) {
  const option = (title, n) =>
    element("option", { value: n }, `${n + 1} of ${titles.length}: ${title}`);
  select.append(...titles.map(option));
}

// Makes the bar say what is shown.
function showState({ box, state, scene, index }) {
  box.querySelector("select").value = index;
  for (const button of all("[data-mode]", box)) {
    press(button, button.dataset.mode === state.mode);
  }
  for (const button of all("[data-view]", box)) {
    press(button, !state.steered && button.dataset.view === state.preset);
    button.disabled = button.dataset.view === "camera" && !scene.frustum;
  }
  box.querySelector(".legend.errors").hidden = state.mode !== "errors";
}

// What a key does; false for one that does nothing.
function command(viewer, key) {
  const { state } = viewer;
  if (PRESETS[key]) viewer.look(PRESETS[key]);
  else if (key === "0") viewer.look(state.preset);
  else if (key === "e") viewer.set({ mode: state.mode === "errors" ? "classes" : "errors" });
  else if (key === "," || key === ".") viewer.step(key === "." ? 1 : -1);
  else return false;
  return true;
}
