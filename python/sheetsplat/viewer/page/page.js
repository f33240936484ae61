// The page: a websocket to the server that the page came from. A lost line is tried again, sooner first.

function socketLine(handlers) {
  const address = new URL("socket", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  let socket = null;
  let wait = 250;
  let closed = false;
  let opened = false;

  function dial() {
    socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      wait = 250;
      opened = true;
      handlers.open();
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") {
        handlers.message(JSON.parse(event.data), null);
        return;
      }
      const size = new DataView(event.data).getUint32(0, true);
      const head = new TextDecoder().decode(new Uint8Array(event.data, 4, size));
      handlers.message(JSON.parse(head), new Uint8Array(event.data, 4 + size));
    };
    socket.onclose = () => {
      if (closed) return;
      handlers.lost(opened ? "The connection is lost; trying again …" : "Connecting …");
      setTimeout(dial, wait);
      wait = Math.min(2 * wait, 4000);
    };
  }
  dial();
  return {
    send(message) {
      if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
    close() {
      closed = true;
      socket.close();
    },
    drop: () => socket.close(),
  };
}

const root = document.createElement("div");
document.body.append(root);
let dialled = null;
window.sheetsplat = mount(root, (handlers) => (dialled = socketLine(handlers)), document);
window.sheetsplat.drop = () => dialled.drop();
