// Sheets that a press shows in their own size, scrolled to where they were pressed.

function makeZoomable(button) {
  const box = button.parentElement;
  button.addEventListener("click", (event) => {
    const before = button.getBoundingClientRect();
    const across = (event.clientX - before.left) / before.width;
    const down = (event.clientY - before.top) / before.height;
    const large = !isPressed(button);
    press(button, large);
    if (!large || event.detail === 0) return;
    const now = button.getBoundingClientRect();
    box.scrollLeft = across * now.width - box.clientWidth / 2;
    box.scrollTop = down * now.height - box.clientHeight / 2;
  });
}
