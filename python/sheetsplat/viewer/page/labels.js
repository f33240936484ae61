// The labels of the data: what each is called, its colour and opacity, and whether it is shown.

// Longer lists can be searched.
const FEW_LABELS = 12;

/** A list of labels. `change` takes the changes of some, {labels: {number: {color, opacity, shown}}}. */
function labelRows(change) {
  let rows = [];
  // What the session may not have told yet: messages that wait are joined by their names alone.
  let sent = {};
  function send(changed) {
    for (const [label, parts] of Object.entries(changed)) sent[label] = { ...sent[label], ...parts };
    change({ labels: sent });
  }
  const search = h("input", { type: "search", className: "text", placeholder: "name or number", oninput: sift, "aria-label": "Labels to list" });
  const searching = h("div", { className: "row" }, h("span", { className: "name" }, "List"), search);
  const list = h("div", { className: "labels", role: "group", "aria-label": "Labels" });
  const none = h("p", { className: "hint", "aria-live": "polite" });
  const listed = () => rows.filter((one) => !one.element.hidden);
  const switchTo = (wanted, some) => {
    for (const one of some) one.box.show(wanted(one));
    send(Object.fromEntries(some.map((one) => [one.label, { shown: wanted(one) }])));
  };
  const element = h("div", {}, searching, h("div", { className: "buttons" },
    button("All on", () => switchTo(() => true, listed()), "Show all labels that are listed"),
    button("All off", () => switchTo(() => false, listed()), "Hide all labels that are listed")), list, none);

  function sift() {
    const text = search.value.trim().toLowerCase();
    for (const one of rows) one.element.hidden = !`${one.name} ${one.label}`.toLowerCase().includes(text);
    none.textContent = listed().length ? "" : "No label has this name or number.";
  }

  function rowOf([label, name]) {
    const box = checkbox(name, (shown) => send({ [label]: { shown } }), `Show ${name} (${label})`);
    const color = colorField((value) => send({ [label]: { color: value } }), `Colour of ${name}`);
    const opacity = h("input", { type: "number", min: 0, max: 1, step: 0.05, className: "number", "aria-label": `Opacity of ${name}` });
    opacity.addEventListener("input", () => {
      if (opacity.value !== "" && opacity.checkValidity()) send({ [label]: { opacity: Number(opacity.value) } });
    });
    const one = { label, name, box, color, opacity };
    const alone = button("Only", () => switchTo((other) => other === one, rows), `Show ${name} only`);
    alone.setAttribute("aria-label", `Only ${name}`);
    one.element = h("div", { className: "label-row" }, box, color, opacity, alone);
    return one;
  }

  element.show = (labels) => {
    sent = {};
    // What has the focus stays where the labels are the same.
    if (rows.length !== labels.length || rows.some((one, n) => one.label !== labels[n][0] || one.name !== labels[n][1])) {
      rows = labels.map(rowOf);
      list.replaceChildren(...rows.map((one) => one.element));
      search.value = "";
    }
    searching.hidden = labels.length <= FEW_LABELS;
    labels.forEach(([, , color, opacity, shown], n) => {
      rows[n].box.show(shown);
      rows[n].color.show(color);
      if (document.activeElement !== rows[n].opacity) rows[n].opacity.value = Number(opacity.toPrecision(4));
    });
    sift();
  };
  return element;
}
