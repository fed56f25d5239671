// Texts in the headset: plates that a 2D canvas draws, in the direction of the page's language.

/** Pixels: of a line, of the letters in it, round the text, of a line at most. */
const [LINE, LETTERS, MARGIN, WIDEST] = [56, 40, 28, 900];

/**
 * A plate as a picture, and its size in lines of text.
 * @param {HTMLCanvasElement} canvas
 * @param {string[]} paragraphs
 */
export function card(canvas, paragraphs) {
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const { dir } = document.documentElement;
  const font = `${LETTERS}px ${getComputedStyle(document.body).fontFamily}`;
  context.font = font;
  const lines = paragraphs.flatMap((text) => wrapped(context, text));
  const width = Math.max(...lines.map((line) => context.measureText(line).width));
  Object.assign(canvas, { width: Math.ceil(width) + 2 * MARGIN, height: lines.length * LINE + 2 * MARGIN });
  context.fillStyle = "rgb(20 22 26 / 0.86)";
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, MARGIN);
  context.fill();
  // A canvas that gets another size forgets its settings.
  Object.assign(context, { font, fillStyle: "#fff", textBaseline: "middle", direction: dir === "rtl" ? "rtl" : "ltr", textAlign: "start" });
  const start = dir === "rtl" ? canvas.width - MARGIN : MARGIN;
  for (const [k, line] of lines.entries()) context.fillText(line, start, MARGIN + (k + 0.5) * LINE);
  return { width: canvas.width / LINE, height: canvas.height / LINE };
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 */
function wrapped(context, text) {
  /** @type {string[]} */
  const lines = [];
  for (const word of text.split(" ")) {
    const longer = lines.length > 0 ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length > 0 && context.measureText(longer).width <= WIDEST) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}
