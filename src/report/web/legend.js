// Names of classes or errors with their colours; a press hides or shows one, two presses in quick
// succession, or one with Shift, leave that one alone.

function fillLegend(legend, entries, shown, onChange) {
  const chips = entries.map(({ name, color }, n) => {
    const swatch = element("i", { style: `--color: rgb(${color.join(" ")})` });
    const chip = element(
      "button",
      { type: "button", title: `hide or show; twice, or with Shift: ${name} alone` },
      swatch,
      name,
    );
    const alone = () => {
      const already = shown.every((on, other) => on === (other === n));
      shown.forEach((_, other) => (shown[other] = already || other === n));
      refresh();
    };
    chip.addEventListener("click", (event) => {
      if (event.shiftKey) return alone();
      shown[n] = !shown[n];
      refresh();
    });
    chip.addEventListener("dblclick", (event) => event.shiftKey || alone());
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
