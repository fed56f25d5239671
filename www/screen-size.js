// How much room there is: the same conditions as in style.css.

/** A phone upright: the panel is a sheet below the picture. */
const sheet = matchMedia("(max-width: 559px), (max-width: 720px) and (min-height: 481px)");
/** A phone, upright or on its side. */
const small = matchMedia("(max-width: 720px), (max-height: 480px)");

export const hasSheet = () => sheet.matches;
export const isSmall = () => small.matches;
