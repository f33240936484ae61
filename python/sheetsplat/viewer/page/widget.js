// The widget: messages of anywidget. Each place where the widget is displayed has a name of its own.

function widgetLine(model, handlers) {
  const place = crypto.randomUUID ? crypto.randomUUID() : String(Math.random()).slice(2);
  const received = (message, buffers) => {
    if (message.place !== place) return;
    if (message.type === "forgotten") {
      handlers.open();
      return;
    }
    const buffer = buffers && buffers[0];
    const bytes = buffer ? new Uint8Array(buffer.buffer || buffer, buffer.byteOffset || 0, buffer.byteLength) : null;
    handlers.message(message, bytes);
  };
  model.on("msg:custom", received);
  // A page that says nothing is forgotten: it may have gone without a word.
  const beat = setInterval(() => model.send({ type: "alive", place }), 1000 * model.get("beat"));
  // The element must be on the page before its size is asked for.
  requestAnimationFrame(() => handlers.open());
  return {
    send: (message) => model.send({ ...message, place }),
    close() {
      clearInterval(beat);
      model.send({ type: "bye", place });
      model.off("msg:custom", received);
    },
  };
}

function render({ model, el }) {
  const root = document.createElement("div");
  root.style.height = `${model.get("height")}px`;
  el.append(root);
  const viewer = mount(root, (handlers) => widgetLine(model, handlers));
  window.sheetsplat = viewer;
  return () => viewer.close();
}

export default { render };
