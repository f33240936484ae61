// Pictures as they are shown: the pixels, with what the page draws over them, as a PNG that still says how it was made.

const SIGNATURE_AND_HEADER = 8 + 25;

/** Returns the text chunks of a PNG, each as it is there. */
function textChunks(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const found = [];
  for (let at = 8; at + 12 <= bytes.length; ) {
    const whole = 12 + view.getUint32(at);
    const kind = String.fromCharCode(...bytes.subarray(at + 4, at + 8));
    if (["tEXt", "iTXt", "zTXt"].includes(kind)) found.push(bytes.subarray(at, at + whole));
    at += whole;
  }
  return found;
}

/** Returns a PNG, as a Blob, of another one over a colour; `paint(context, width, height)` draws over it. */
async function composed(bytes, color, paint) {
  const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }), { colorSpaceConversion: "none" });
  const canvas = h("canvas", { width: image.width, height: image.height });
  const context = canvas.getContext("2d");
  context.fillStyle = color;
  context.fillRect(0, 0, image.width, image.height);
  context.drawImage(image, 0, 0);
  paint(context, image.width, image.height);
  image.close();
  const blob = await new Promise((take) => canvas.toBlob(take, "image/png"));
  const made = new Uint8Array(await blob.arrayBuffer());
  const parts = [made.subarray(0, SIGNATURE_AND_HEADER), ...textChunks(bytes), made.subarray(SIGNATURE_AND_HEADER)];
  return new Blob(parts, { type: "image/png" });
}
