// Scale and paper of a drawing of lines: usual scales, the sheets of ISO 216, and a drawing in the middle of one of them.

/** Usual scales, 50 for 1:50. */
export const SCALES = [1, 2, 5, 10, 20, 25, 50, 100, 200, 250, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000];

/** Landscape, mm. @type {[name: string, size: [number, number]][]} */
export const PAPERS = [
  ["A4", [297, 210]],
  ["A3", [420, 297]],
  ["A2", [594, 420]],
  ["A1", [841, 594]],
  ["A0", [1189, 841]],
];

/**
 * The sheet for a drawing of so many millimetres, turned as the drawing needs it; null for one as large as the drawing. `paper`: a name of {@link PAPERS},
 * `auto` for the smallest that fits, `fit` for one as large as the drawing.
 * @param {number[]} size
 * @param {string} paper
 * @returns {{on: number[] | null, isTooLarge: boolean}}
 */
export function sheetOf([width, height], paper) {
  if (paper === "fit") return { on: null, isTooLarge: false };
  const isTall = height > width;
  const sheets = PAPERS.filter(([name]) => paper === "auto" || name === paper).flatMap(([, [w, h]]) =>
    isTall
      ? [
          [h, w],
          [w, h],
        ]
      : [
          [w, h],
          [h, w],
        ],
  );
  const on = sheets.find(([w, h]) => width <= w && height <= h) ?? null;
  return { on, isTooLarge: !on };
}

/** @param {number[]} sheet as {@link sheetOf} has it */
export const nameOf = (sheet) => PAPERS.find(([, size]) => size[0] === Math.max(...sheet))?.[0] ?? "";

/** How a drawing begins (core/measure, svg.rs): it has its size in millimetres, counts in them, and has a title and a white ground. */
const HEAD = /<svg [^>]*width="([\d.]+)mm" height="([\d.]+)mm" viewBox="[^"]*">\s*(<title>[^<]*<\/title>)\s*<rect width="100%" height="100%" fill="#fff"\/>/;

/**
 * Width and height of a drawing, mm.
 * @param {string} svg
 */
export function sizeIn(svg) {
  const head = HEAD.exec(svg);
  if (!head) throw new Error("the drawing has no size");
  return [Number(head[1]), Number(head[2])];
}

/**
 * The same drawing in the middle of a sheet of so many millimetres.
 * @param {string} svg
 * @param {number[]} sheet
 */
export function onSheet(svg, [width, height]) {
  const [w, h] = sizeIn(svg);
  const by = [(width - w) / 2, (height - h) / 2].map((v) => Number(v.toFixed(3)));
  const tag = `<svg xmlns="http://www.w3.org/2000/svg" width="${width}mm" height="${height}mm" viewBox="0 0 ${width} ${height}">`;
  const put = (/** @type {string[]} */ ...[, , , title]) =>
    `${tag}\n${title}\n<rect width="100%" height="100%" fill="#fff"/>\n<g transform="translate(${by.join(" ")})">`;
  return svg.replace(HEAD, put).replace(/<\/svg>\s*$/, "</g>\n</svg>\n");
}
