// The shadings by their names in links and in the API (viewer/src/display.rs): for each the key of the message that names it to people.

/** @type {Record<string, string>} */
export const SHADINGS = {
  colour: "modeColor",
  clay: "modeClay",
  headlight: "modeHeadlight",
  raking: "modeRaking",
  curvature: "modeCurvature",
  "eye-dome": "modeEyeDome",
  normals: "modeNormals",
  height: "modeHeight",
  distance: "modeDistance",
  scalar: "modeScalar",
  level: "modeLevels",
  error: "modeError",
};
