// Names of classes or errors with their colours; a press hides or shows one, two presses in quick
// succession leave that one alone.

function fillLegend(legend, entries, shown, onChange) {
  const chips = entries.map(({ name, color }, n) => {
    const swatch = element("i", { style: `--color: rgb(${color.join(" ")})` });
    const chip = element(
      "button",
      { type: "button", title: `hide or show; twice: ${name} alone` },
      swatch,
      name,
    );
    chip.addEventListener("click", () => {
      shown[n] = !shown[n];
      refresh();
    });
    chip.addEventListener("dblclick", () => {
      const alone = shown.every((on, other) => on === (other === n));
      shown.forEach((_, other) => (shown[other] = alone || other === n));
      refresh();
    });
    return chip;
  });
  const say = () => chips.forEach((chip, n) => press(chip, shown[n]));
  const refresh = () => {
    say();
    onChange();
  };
  say();
  legend.replaceChildren(...chips);
}
