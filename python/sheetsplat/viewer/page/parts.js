// Elements of the page: small functions that return an element, with a method `show` that sets what it shows.

/** What arrow keys mean: to the right, upwards. */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** Makes an element. Attributes that begin with "on" are listeners; texts are never read as HTML. */
function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && name !== "list") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** A number in few characters. */
function shortNumber(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3)) {
    return value.toExponential(2).replace(/\.?0*e/, "e").replace("e+", "e").replace("-", "−");
  }
  return String(Number(value.toPrecision(4))).replace("-", "−");
}

function row(label, ...parts) {
  return h("label", { className: "row" }, h("span", { className: "name" }, label), ...parts);
}

/** A slider with the number beside it. `change` gets numbers, also while it is dragged. */
function slider(label, { low, high, power = 1, change, title = "" }) {
  const place = (value) => 1000 * ((Math.min(Math.max(value, low), high) - low) / (high - low || 1)) ** (1 / power);
  const number = h("input", { type: "number", step: "any", className: "number", "aria-label": label });
  const range = h("input", { type: "range", min: 0, max: 1000, step: 1, "aria-label": label });
  const element = h("div", { className: "row", title }, h("span", { className: "name" }, label), range, number);
  range.addEventListener("input", () => {
    const value = low + (high - low) * (range.value / 1000) ** power;
    number.value = Number(value.toPrecision(4));
    change(Number(number.value));
  });
  number.addEventListener("change", () => {
    const value = Number(number.value);
    if (number.value === "" || !Number.isFinite(value)) return;
    range.value = place(value);
    change(value);
  });
  element.limits = (first, last) => {
    low = first;
    high = last;
  };
  element.show = (value) => {
    if (document.activeElement === number || element.matches(":active")) return;
    number.value = Number(Number(value).toPrecision(6));
    range.value = place(value);
  };
  return element;
}

function checkbox(label, change, title = "") {
  const box = h("input", { type: "checkbox", onchange: () => change(box.checked) });
  const element = h("label", { className: "check", title }, box, h("span", {}, label));
  element.show = (on) => {
    box.checked = Boolean(on);
  };
  return element;
}

/** A choice of several; `options` are texts or pairs [value, text]. */
function choice(options, change, title = "") {
  const element = h("select", { title, "aria-label": title, onchange: () => change(element.value) });
  element.offer = (given) => {
    const pairs = given.map((one) => (Array.isArray(one) ? one : [one, one]));
    element.replaceChildren(...pairs.map(([value, text]) => h("option", { value }, text)));
  };
  element.show = (value) => {
    element.value = value;
  };
  element.offer(options);
  return element;
}

function button(text, action, title = text) {
  // What people see is what it is called; signs have no name of their own.
  const name = /[a-z]{2}/i.test(text) ? {} : { "aria-label": title };
  return h("button", { type: "button", title, ...name, onclick: action }, text);
}

function colorField(change, title = "Colour") {
  const element = h("input", { type: "color", title, "aria-label": title, oninput: () => change(element.value) });
  element.show = (value) => {
    if (value) element.value = value;
  };
  return element;
}

/** Red, green, blue from 0 to 1 of "#rrggbb", and back. */
const partsOf = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
const hexOf = (color) =>
  "#" + color.map((part) => Math.round(255 * Math.min(Math.max(part, 0), 1)).toString(16).padStart(2, "0")).join("");

/** A part of the panel that can be folded. */
function section(title, open, ...children) {
  const element = h("details", { open }, h("summary", {}, title), h("div", { className: "inside" }, ...children));
  return element;
}

/** Calls a function at most once a frame of the screen, with what was given last. */
function perFrame(action) {
  let waiting = false;
  return () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      action();
    });
  };
}

/** Fits a canvas to its place on the screen and returns its context in CSS pixels, with width and height. */
function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** Follows a pointer from where it was pressed until it is released. */
function dragging(element, { start, move, end = () => {} }) {
  element.addEventListener("pointerdown", (event) => {
    const follow = start(event);
    if (!follow) return;
    event.preventDefault();
    event.stopPropagation();
    element.setPointerCapture(event.pointerId);
    const moved = (later) => move(later, follow);
    const done = (later) => {
      element.removeEventListener("pointermove", moved);
      element.removeEventListener("pointerup", done);
      element.removeEventListener("pointercancel", done);
      end(later, follow);
    };
    element.addEventListener("pointermove", moved);
    element.addEventListener("pointerup", done);
    element.addEventListener("pointercancel", done);
  });
}

/** Round numbers of an axis, about as many as wanted, between two values. */
function ticks(low, high, wanted) {
  const rough = (high - low) / Math.max(wanted, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) return [];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].find((factor) => factor * power >= rough) * power;
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) found.push(n * step);
  return found;
}
