// Types of the viewer's API: of `<kilwa-viewer>` (promises), and of `kilwa.api` inside the viewer's page (direct).
// Lengths are metres of the pack's coordinates (x east, y north, z up), angles radians, pixels CSS pixels of the picture.

export type Vector = [x: number, y: number, z: number];
export type ViewName = "plan" | "north" | "east" | "south" | "west" | "iso" | "below";
export type ToolName = "orbit" | "pan" | "walk";
export type Language = "en" | "fr" | "pt" | "sw" | "ar";

export interface Camera {
  /** Where the eye stands, seen from the target: from north, clockwise. */
  azimuth: number;
  /** How high the eye stands, -π/2 to π/2. */
  elevation: number;
  /** From the eye to the target. */
  distance: number;
  target: Vector;
  orthographic: boolean;
  /** How far the picture's top leans to the left. */
  roll: number;
  /** Vertical opening angle. */
  fieldOfView: number;
}

export interface Stats {
  /** Chunks that the target cut needs, those of them that are not there, and all in memory. */
  chunksWanted: number;
  chunksMissing: number;
  chunksResident: number;
  /** Chunks asked for or being decoded, and of which something is on screen. */
  chunksInFlight: number;
  chunksShown: number;
  /** Pages of the directory that the view waits for. */
  pagesMissing: number;
  requestsInFlight: number;
  /** Requests of the pack: by the streaming, and with that for the head of the file. */
  requestsMade: number;
  requests: number;
  failures: number;
  bytesWanted: number;
  bytesMissing: number;
  /** Since the model was opened, the head of the file not counted. */
  bytesReceived: number;
  bytesInFlight: number;
  bytesShown: number;
  gpuBytes: number;
  gpuLimit: number;
  trianglesDrawn: number;
  patchesDrawn: number;
  /** Largest error on screen, in device pixels, and what is aimed at. */
  worstPixelError: number;
  targetPixels: number;
  /** What is aimed at while the camera moves, so that frames come often enough; and the time from one to the next then. */
  pixelsWhileMoving: number;
  frameMs: number;
  /** Largest certified error of the surface on screen. */
  worstErrorMetres: number;
  /** Whether the target cut is complete. */
  targetReached: boolean;
  /** Whether the memory limit keeps it coarser. */
  budgetLimited: boolean;
  /** Whether it is coarser because the file is incomplete. */
  cutOff: boolean;
  /** All is drawn that came and was done; nothing more will change by itself. */
  settled: boolean;
  /** Frames drawn since the model was opened or the graphics device replaced. */
  frames: number;
  adapter: string;
  [more: string]: unknown;
}

export interface Hit {
  place: Vector;
  /** Certified error of the surface there. */
  error: number;
  /** What was looked along: measurements are made where it meets the finest surface. */
  ray: Ray;
}

export interface Ray {
  origin: Vector;
  direction: Vector;
}

export type MeasureToolName =
  | "coordinate"
  | "distance"
  | "polyline"
  | "along"
  | "perimeter"
  | "angle"
  | "plane-angle"
  | "height"
  | "circle"
  | "area"
  | "area-whole"
  | "volume"
  | "cut-fill"
  | "deviation"
  | "section"
  | "section-upright"
  | "section-level"
  | "section-points"
  | "section-clip"
  | "profile"
  | "contours";

export interface Reading {
  /** English and stable: `straight`, `horizontal`, `surface`, `volume` … */
  name: string;
  dimension: "length" | "area" | "volume" | "angle" | "ratio";
  /** Metres, square or cubic metres, radians. */
  value: number;
  /** Standard uncertainty, in the same unit. */
  uncertainty: number;
  /** Only if the accuracy of the survey is unknown, in the same unit: digits finer than this are not shown. */
  resolution?: number;
}

export interface Measurement {
  id: string;
  name: string;
  /** As in files: paths are `distance`, sections of every kind `section`. */
  tool: string;
  /** Its values count when it is `final`. */
  state: "picking" | "measuring" | "final" | "refused" | "missed" | "failed";
  points: Vector[];
  readings: Reading[];
  /** Why there is no value. */
  refusal: string | null;
  color: string;
  hidden: boolean;
  note: string;
}

export interface NewMeasurement {
  tool: MeasureToolName;
  /** Places, taken as they are. */
  points?: Vector[];
  /** Rays, as `pick` gives them; their places are where they meet the finest surface. */
  rays?: Ray[];
  plane?: { point: Vector; normal: Vector };
  /** From contour to contour. */
  interval?: number;
  /** How far from its plane a polygon counts the surface. */
  reach?: number;
  name?: string;
  note?: string;
  /** `#rrggbb` */
  color?: string;
}

export interface Annotation {
  id: string;
  title: string;
  text: string;
  /** http or https, or empty. */
  link: string;
  place: Vector;
  /** As in the address: azimuth, elevation, distance, x, y, z, 1 where parallel, roll, opening angle. */
  camera: number[] | null;
  display: Record<string, unknown> | null;
}

export interface State {
  camera: number[];
  display: Record<string, unknown> | null;
  notes: boolean;
  annotation: string | null;
  measurements: string | null;
  pack: string;
}

export interface PictureOptions {
  /** 16 to 16384; left out: the canvas's. */
  width?: number;
  height?: number;
  scaleBar?: boolean;
  transparent?: boolean;
}

export interface Events {
  ready: null;
  frame: Stats;
  /** The camera came to rest. */
  camera: Camera;
  annotation: { id: string | null };
  annotations: { count: number };
  /** One became final. */
  measurement: Measurement;
  /** Their list changed. */
  measurements: { count: number };
  trouble: { kind: string };
}

/** Every method as it is inside the page. */
export interface KilwaMethods {
  stats(): Stats | null;
  info(): { metadata: Record<string, unknown>; pack: Record<string, unknown> } | null;
  getCamera(): Camera;
  setCamera(camera: Partial<Camera>, options?: { ease?: boolean }): Promise<boolean>;
  getMode(): string;
  setMode(mode: string): void;
  modes(): string[];
  pick(x: number, y: number): Hit | null;
  /** Height of the surface on screen below a place; null where there is none. */
  groundBelow(place: Vector): number | null;
  view(name: ViewName): Promise<boolean>;
  fit(): Promise<boolean>;
  home(): Promise<boolean>;
  back(): boolean;
  forward(): boolean;
  setTool(name: ToolName): void;
  annotations(): Annotation[];
  addAnnotation(note: { place: Vector; title?: string; text?: string; link?: string; camera?: number[] | null }): string;
  openAnnotation(id: string): boolean;
  closeAnnotation(): void;
  showAnnotations(shown: boolean): void;
  measurements(): Promise<Measurement[]>;
  addMeasurement(measurement: NewMeasurement): Promise<Measurement>;
  removeMeasurement(id: string): Promise<boolean>;
  state(): State;
  setState(state: Partial<State>): void;
  link(): string;
  picture(options?: PictureOptions): Promise<Blob>;
  setLanguage(language: Language): Promise<void>;
}

/** `kilwa.api` in the viewer's page. */
export interface KilwaApi extends KilwaMethods {
  readonly isReady: boolean;
  camera: Camera;
  mode: string;
  on<E extends keyof Events>(event: E, listener: (detail: Events[E]) => void): () => void;
}

type Promised<T> = { [K in keyof T]: T[K] extends (...args: infer A) => infer R ? (...args: A) => Promise<Awaited<R>> : never };

/** `<kilwa-viewer>`. */
export interface KilwaViewerElement extends HTMLElement, Promised<KilwaMethods> {
  src: string;
  /** Resolves when the viewer answers; rejects where it does not within `patience` after its page has loaded, as where it does not allow this origin. Asked again, it waits again. */
  readonly loaded: Promise<void>;
  call(name: string, ...args: unknown[]): Promise<unknown>;
  on<E extends keyof Events>(event: E, listener: (detail: Events[E]) => void): () => void;
}
export declare const KilwaViewerElement: {
  new (): KilwaViewerElement;
  prototype: KilwaViewerElement /** Milliseconds; 15,000 unless set. */;
  patience: number;
  /** Milliseconds after which a viewer's page that has loaded and sends nothing is taken for blocked, and the element says so. */
  silence: number;
};

declare global {
  interface HTMLElementTagNameMap {
    "kilwa-viewer": KilwaViewerElement;
  }
}
