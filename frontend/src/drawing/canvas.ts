/** Rendering capabilities of the browser, and canvases in main memory. */

const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

let known: boolean | null = null;

/** Whether the browser renders on the CPU because it has no GPU. */
export function paintsInSoftware(): boolean {
  known ??= rendererIsSoftware();
  return known;
}

function rendererIsSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl");
  if (gl === null) return true;
  const details = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(details?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return SOFTWARE.test(name);
}

/** Whether the browser supports WebGL 2, which the 3D view requires. */
export function canDrawSolid(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return gl !== null;
}

/**
 * Runs `build` so that its 2D canvases are in main memory. With an emulated GPU, curves of some thousand points cost
 * about ten times as much otherwise; uPlot has no option for this.
 */
export function withMemoryCanvases<Built>(build: () => Built): Built {
  const prototype = HTMLCanvasElement.prototype;
  const original = prototype.getContext;
  prototype.getContext = function inMemory(this: HTMLCanvasElement) {
    return original.call(this, "2d", { willReadFrequently: true });
  } as typeof original;
  try {
    return build();
  } finally {
    prototype.getContext = original;
  }
}
