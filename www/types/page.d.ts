// Types that several parts of the page share. Lengths are metres, angles radians, unless a field says otherwise.

import type { Camera, Measurement, Stats } from "../kilwa-viewer.js";
import type { Viewer } from "../viewer.js";

export type { Annotation, Measurement, NewMeasurement, PictureOptions, State } from "../kilwa-viewer.js";
export type { Camera, Viewer };

/** The module that wasm-bindgen wrote for the viewer, ready to be called. */
export type Program = typeof import("../viewer.js");

/** Where the bytes of a pack come from: over HTTP (loader.js) or from this computer (local-pack.js). */
export type PackSource = import("../loader.js").Pack | import("../local-pack.js").LocalPack;

/** What `packInfo` of the viewer reports. */
export interface PackInfo {
  metadata: {
    title: string;
    crs: string | null;
    lattice_step: number;
    bounds_min: number[];
    bounds_max: number[];
    median_edge: number;
    triangles: number;
    vertices: number;
    sources: { name: string; bytes: number; sha256: string }[];
    tool: string;
    capture_accuracy?: number | null;
    capture_registration?: number;
    capture_instrument?: number;
    repairs: Record<string, number>;
  };
  pack: {
    hash: string;
    bytes: number;
    entries: number;
    triangles: number;
    storedTriangles: number;
    colors: boolean;
    scalars: number;
    /** Whether it is made of points: each point counts as two triangles. */
    points: boolean;
    lattice: Lattice;
  };
}

export interface Lattice {
  origin: number[];
  step_log2: number;
}

export interface Plane {
  normal: number[];
  point: number[];
}

export interface Box {
  center: number[];
  size: number[];
  /** Degrees clockwise, seen from above. */
  turn?: number;
  removeInside?: boolean;
}

/** `Viewer.displayState()`: what is left out is the default (viewer/src/display.rs). */
export interface DisplayState {
  mode?: string;
  /** Degrees. */
  light?: { azimuth: number; elevation: number; withView?: boolean };
  onColour?: boolean;
  shading?: number;
  strength?: number;
  radius?: number;
  feature?: number;
  plane?: Plane;
  range?: [low: number, high: number];
  channel?: string;
  channelRange?: [low: number, high: number];
  /** Hide the surface that a merge filled. */
  hideFilled?: boolean;
  backFaces?: boolean;
  background?: string;
  fade?: boolean;
  clipPlane?: Plane;
  clipBox?: Box;
  outline?: boolean;
}

/** `Viewer.legend()`. */
export interface Legend {
  scale: boolean;
  stops: number[][];
  noValue: number[];
  low: number;
  high: number;
  unit: string;
  channel: string | null;
  channels: { name: string; min: number; max: number }[];
  plane: Plane;
  feature: number;
}

/** The figures of a frame, as the viewer returns them. */
export interface FrameStats extends Stats {
  /** When something that failed is tried again; negative where nothing waits. */
  retryInMs: number;
  /** Another frame is needed. */
  more: boolean;
  /** The graphics device is gone. */
  lost: boolean;
}

/** What the viewer asks the page to do. `parts`: offset, length, offset, length… */
export type Command =
  | { type: "fetch"; request: number; parts: number[]; pages: boolean }
  | { type: "cancel"; request: number }
  | DecodeCommand
  | { type: "evict"; chunk: number };

export interface DecodeCommand {
  type: "decode";
  chunk: number;
  request: number;
  offset: number;
  length: number;
  vertices: number;
  triangles: number;
  checksum: Uint8Array;
}

/** A picture or a part of one, red, green, blue and alpha bytes. */
export interface Pixels {
  width: number;
  height: number;
  pixels: Uint8Array;
}

/** A note, as annotations.js reads and writes it. */
export interface Note {
  id: string;
  title: string;
  text: string;
  link: string;
  place: number[];
  /** Camera as numbers (camera.js). */
  camera: number[] | null;
  display: DisplayState | null;
  created?: string | null;
  modified?: string | null;
  /** The annotation of the file that it was read from. */
  // biome-ignore lint/suspicious/noExplicitAny: JSON that others wrote; annotations.js looks at every part of it.
  source?: any;
}

export interface SavedView {
  id: string;
  name: string;
  camera: number[];
  display: DisplayState | null;
}

/** Camera and display as saved views and notes keep them. */
export interface Seen {
  camera: number[];
  display: DisplayState | null;
}

/** What the address of the page holds (link.js). */
export interface PageState {
  camera: number[] | null;
  display: DisplayState | null;
  notes: boolean;
  annotation: string | null;
  measurements: string | null;
  pack: string | null;
}

/** How a place was chosen on the picture. */
export interface Placing {
  /** Shift was held: snap to the nearest vertex. */
  snap?: boolean;
  /** By the crosshair, which stays. */
  isKey?: boolean;
}

export type Tool = "orbit" | "pan" | "walk" | "note" | "measure" | "points";

/** Anything that goes wrong while bytes are fetched or read: see PackError in loader.js. */
export interface Failure {
  name?: string;
  message: string;
  kind?: string;
  said?: Message | null;
  bytes?: number;
  host?: string;
  signIn?: string | null;
}

/** A message of the measuring engine (core/measure): a code, and values by name. */
export interface Message {
  code: string;
  values?: Record<string, Value>;
  english?: string;
}

export type Value = { count: number } | { metres: number } | { share: number } | { number: number } | { word: string };

/** A button beside a notice. */
export interface NoticeAction {
  label: string;
  run: () => void;
}

// Measuring.

export type Reading = Measurement["readings"][number];

/** A tool of the Measurements tab (measure/tools.js). */
export interface MeasureTool {
  id: string;
  /** Its string. */
  key: string;
  /** Its name in files, where it is another one. */
  tool?: string;
  /** Fewest and most places. */
  min: number;
  max: number;
  often?: boolean;
  /** The places enclose something. */
  closed?: boolean;
  /** It counts from a plane that can be chosen. */
  plane?: boolean;
  /** What comes out are lines. */
  draws?: boolean;
  interval?: boolean;
  /** Strings of its single steps, where they say more than a number. */
  steps?: (string | null)[];
}

/** Standard uncertainty by source, metres; capture is null where nobody knows it. */
export interface Uncertainty {
  lattice: number;
  level: number;
  capture: number | null;
  /** The parts of `capture`, if known; `registration` is that of the least certain point. */
  registration?: number;
  instrument?: number;
  /** Of the least exactly picked point; absent where no point was picked on a picture. */
  pointing?: number;
}

export interface Line {
  closed: boolean;
  /** In the drawing: x to the right, y up, metres. */
  flat: number[][];
  world: number[][];
}

/** A measurement as in files, in the browser's store and in addresses (core/measure, saved.rs). */
export interface MeasureRecord {
  id?: string;
  name?: string;
  tool: string;
  /** The page's own tool, which is finer than the file's. */
  kind?: string;
  local?: (number[] | null)[];
  world?: (number[] | null)[];
  rays?: (Ray | null)[];
  /** Standard uncertainty of where each point was pointed at, metres. */
  pointing?: number[];
  plane?: Plane | null;
  reach?: number | null;
  interval?: number | null;
  readings?: Reading[];
  uncertainty?: Uncertainty | null;
  date?: string | null;
  fitted?: Plane | null;
  color?: string;
  hidden?: boolean;
  note?: string;
  foreign?: ForeignPack | null;
}

export type Ray = { origin: number[]; direction: number[] };

/** The pack that a measurement was made on, where it is not this one. */
export interface ForeignPack {
  title: string;
  identity: string;
}

/** An entry of the list of measurements. */
export interface MeasureItem {
  id: string;
  name: string;
  color: string;
  hidden: boolean;
  note: string;
  foreign: ForeignPack | null;
  task: import("../measure/task.js").Task;
}

/** What the measuring engine answers. */
export interface MeasureAnswer {
  refusal?: string;
  said?: Message;
  readings: Reading[];
  parts?: { what: string; value: number | string | null }[];
  remarks?: Message[];
  lines?: Line[];
  read?: { chunks: number; bytes: number; of_chunks: number; of_bytes: number } | null;
  uncertainty?: Uncertainty | null;
  details?: { plane?: Plane } | null;
}

/** What the engine reports of the pack it has opened. */
export interface EnginePack {
  identity: string;
  title: string;
  crs: string | null;
  lattice: Lattice;
  step: number;
  capture: number;
  bytes: number;
  triangles: number;
  program: string;
}

export interface Progress {
  done?: number;
  all?: number;
  /** Seconds until the connection is tried again. */
  waiting?: number | null;
}

/** How the engine is asked something. */
export interface Asking {
  progress?: (progress: Progress) => void;
  signal?: AbortSignal;
}

/** Bytes that the engine's worker asks for; `call`: the question that needs them. */
export interface Need {
  need: number;
  call: number;
  offset: number;
  length: number;
  fresh: boolean;
}

/** A question that is under way. */
export interface Call {
  resolve: (result: unknown) => void;
  reject: (error: unknown) => void;
  progress: (progress: Progress) => void;
  controller: AbortController;
  /** Of a drawing. */
  host?: SheetHost;
  /** Why its bytes did not come, or its host failed. */
  failure?: Failure;
}

/** What is known of a place along a ray before the finest surface is (measure/engine.js). */
export interface Provisional {
  local: number[] | null;
  world: number[] | null;
  low: number;
  high: number;
  stretches: number;
  error: number;
}

/** A mark on a drawing to scale: grey 0 to 1, millimetres of paper. */
export type Mark =
  | { is: "box"; at: number[]; size: number[]; grey: number }
  | { is: "triangle"; corners: number[][]; grey: number }
  | { is: "text"; at: number[]; height: number; anchor: "start" | "middle" | "end"; words: string };

/** What is asked for of a drawing to scale. */
export interface SheetAsked {
  view: string;
  scale: number;
  dpi: number;
  paper?: string;
  bare?: boolean;
  title: string;
  format: "png" | "pdf" | "tif";
  /** Of the page's texts. */
  direction: CanvasDirection;
  /** Widest part that the graphics card draws, pixels. */
  widest: number;
}

/** What the page does for a drawing; `ended` is aborted when the drawing ends. */
export interface SheetHost {
  open(ended: AbortSignal, size: [width: number, height: number]): Promise<void>;
  /** From the point in its middle and half of its height, metres, and its size in pixels: its pixels, whether it is as fine as they are, its error in metres, its triangles. */
  part(ended: AbortSignal, x: number, y: number, z: number, halfHeight: number, width: number, height: number): Promise<unknown>;
  /** The next of a PNG: three bytes per pixel. */
  rows(ended: AbortSignal, rgb: Uint8Array): Promise<void>;
  write(ended: AbortSignal, bytes: Uint8Array<ArrayBuffer>): Promise<void>;
  head(ended: AbortSignal, bytes: Uint8Array<ArrayBuffer>): Promise<void>;
}

/** A drawing that was made: its paper in mm, the text of the world file of a plan, whether all of it is as fine as its pixels. */
export interface SheetMade {
  paper: number[];
  world: string | null;
  isFull: boolean;
}

/** Where a file goes while it is made (sink.js). */
export interface Sink {
  write(bytes: Uint8Array<ArrayBuffer>): void | Promise<void>;
  head(bytes: Uint8Array<ArrayBuffer>): void | Promise<void>;
  end(): Promise<Blob | null>;
  abort(): void | Promise<void>;
}
