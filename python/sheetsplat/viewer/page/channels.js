// Several groups of data beside each other, and another array that gives colours.

/** A row for each group that has a look: whether it is shown, and its colour. `set` sends changes. */
function channelRows(set) {
  let rows = [];
  const element = h("div", { role: "group", "aria-label": "Channels" });
  function rowOf(name, group) {
    const box = checkbox(name, (shown) => set({ look: { group, shown } }), `Show ${name}`);
    const color = colorField((value) => set({ look: { group, color: value } }), `Colour of ${name}`);
    return { name, box, color, element: h("div", { className: "label-row" }, box, color) };
  }
  element.show = (looks, groups) => {
    element.hidden = looks.length < 2;
    const known = looks.flatMap((look, n) => (look ? [[look, n, `${n + 1}: ${groups[n].label}`]] : []));
    if (rows.length !== known.length || rows.some((one, at) => one.name !== known[at][2])) {
      rows = known.map(([, n, name]) => rowOf(name, n));
      element.replaceChildren(...rows.map((one) => one.element));
    }
    known.forEach(([{ shown, color }], at) => {
      rows[at].box.show(shown);
      rows[at].color.hidden = color === null;
      rows[at].color.show(color);
    });
  };
  return element;
}

/** Which array gives the colours, by which map. `set` sends changes. */
function colorByRows(set, offered) {
  const names = choice([], (name) => set({ color_by: name || null }), "Array that gives the colours");
  const maps = choice([], (name) => set({ color_map: name }), "Colours of that array");
  const mapped = row("Its colours", maps);
  const element = h("div", {}, row("Colour by", names), mapped);
  element.show = (state, data) => {
    element.hidden = !data.color_names.length || !COLORED.includes(state.fold);
    names.offer([["", "the values themselves"], ...data.color_names]);
    names.show(state.color_by || "");
    mapped.hidden = !state.color_by;
    const known = Object.keys(offered().colormaps);
    maps.offer([...(known.includes(state.color_map) ? [] : [[state.color_map, state.color_map || "own colours"]]), ...known]);
    maps.show(state.color_map);
  };
  return element;
}
