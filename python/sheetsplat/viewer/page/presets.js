// Looks that somebody named, kept in this browser.

const PRESETS_KEY = "sheetsplat-presets";

/** What is kept under a name in the browser, as an object; notebooks may forbid it. */
function keptPresets() {
  try {
    const found = JSON.parse(localStorage.getItem(PRESETS_KEY) || "{}");
    return found && typeof found === "object" && !Array.isArray(found) ? found : {};
  } catch {
    return {};
  }
}

/** Rows in which looks are kept and taken; `current()` returns the look that is shown, `change` takes a part of one. */
function presetRows(current, change) {
  const names = choice([], (name) => {
    const kept = keptPresets()[name];
    if (kept) change(kept);
    show();
    names.show(name);
    forget.hidden = !name;
  }, "Own preset");
  const name = h("input", { type: "text", className: "text", maxLength: 60, placeholder: "name", "aria-label": "Name of the preset to keep" });
  const keep = button("Keep", () => {
    const called = name.value.trim();
    if (!called) {
      name.focus();
      return;
    }
    // Colours that a map does not name are kept by their points.
    const { cmap, range, colors, opacity } = current();
    const rows = colors.map(([at, color]) => [at, ...partsOf(color)]);
    write({ ...keptPresets(), [called]: cmap ? { range, cmap, opacity } : { colors: rows, opacity } });
    name.value = "";
    names.show(called);
    forget.hidden = false;
  }, "Keep these colours and opacities in this browser");
  const forget = button("Forget", () => {
    const { [names.value]: _, ...others } = keptPresets();
    write(others);
  }, "Forget the own preset");
  name.addEventListener("keydown", (event) => {
    if (event.key === "Enter") keep.click();
  });
  const taking = row("Own preset", names, forget);

  function write(kept) {
    try {
      localStorage.setItem(PRESETS_KEY, JSON.stringify(kept));
    } catch {
      name.placeholder = "this browser keeps nothing";
    }
    show();
  }
  function show() {
    const known = Object.keys(keptPresets()).sort();
    taking.hidden = !known.length;
    const before = names.value;
    names.offer([["", "choose …"], ...known]);
    names.show(known.includes(before) ? before : "");
    forget.hidden = !names.value;
  }
  show();
  return [taking, h("div", { className: "row" }, h("span", { className: "name" }, "Keep as"), name, keep)];
}
