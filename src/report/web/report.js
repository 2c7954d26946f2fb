// What the page says of itself, for tests and for whoever reports a fault: counts, and errors.

const root = document.documentElement;
const all = (selector, from = document) => [...from.querySelectorAll(selector)];

function report(name, value) {
  root.dataset[name] = value;
}

function count(name, selector) {
  report(name, all(selector).length);
}

addEventListener("error", (event) => report("error", event.message));
addEventListener("unhandledrejection", (event) => report("error", String(event.reason)));

// An element with attributes, properties and children: text needs no escaping here.
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Buttons that stay pressed.
function press(button, isDown) {
  button.setAttribute("aria-pressed", isDown);
}

function isPressed(button) {
  return button.getAttribute("aria-pressed") === "true";
}
