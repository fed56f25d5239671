// What the page uses of the WebXR Device API (https://www.w3.org/TR/webxr/), which TypeScript's own libraries do not declare.

interface Document {
  /** Only Chromium has it (https://w3c.github.io/webappsec-permissions-policy/). */
  readonly featurePolicy?: { allowsFeature(feature: string): boolean };
}

interface Navigator {
  readonly xr?: XRSystem;
}

interface XRSystem {
  isSessionSupported(mode: "immersive-vr"): Promise<boolean>;
  requestSession(mode: "immersive-vr", options: { optionalFeatures: string[] }): Promise<XRSession>;
}

interface XRSession extends EventTarget {
  readonly inputSources: Iterable<XRInputSource>;
  updateRenderState(state: { baseLayer?: XRWebGLLayer; depthNear?: number }): void;
  requestReferenceSpace(type: "local-floor" | "local"): Promise<XRReferenceSpace>;
  requestAnimationFrame(callback: (time: number, frame: XRFrame) => void): number;
  end(): Promise<void>;
}

interface XRReferenceSpace extends EventTarget {
  getOffsetReferenceSpace(offset: XRRigidTransform): XRReferenceSpace;
}

interface XRInputSource {
  readonly handedness: "none" | "left" | "right";
  readonly targetRaySpace: EventTarget;
  readonly gripSpace?: EventTarget;
  readonly gamepad?: Gamepad;
}

interface XRInputSourceEvent extends Event {
  readonly frame: XRFrame;
  readonly inputSource: XRInputSource;
}

interface XRFrame {
  getViewerPose(space: XRReferenceSpace): (XRPose & { readonly views: readonly XRView[] }) | null | undefined;
  getPose(space: EventTarget, base: XRReferenceSpace): XRPose | null | undefined;
}

interface XRPose {
  readonly transform: XRRigidTransform;
}

interface XRView extends XRPose {
  readonly projectionMatrix: Float32Array;
}

declare class XRRigidTransform {
  constructor(position: { x?: number; y?: number; z?: number });
  /** Column after column. */
  readonly matrix: Float32Array;
}

declare class XRWebGLLayer {
  constructor(session: XRSession, context: WebGL2RenderingContext, init: { alpha: boolean; antialias: boolean; depth: boolean; stencil: boolean });
  /** An emulator's layer is the canvas itself: null. */
  readonly framebuffer: WebGLFramebuffer | null;
  readonly framebufferWidth: number;
  readonly framebufferHeight: number;
  getViewport(view: XRView): { readonly x: number; readonly y: number; readonly width: number; readonly height: number } | null | undefined;
}
