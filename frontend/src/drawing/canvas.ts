/** Where the charts' canvases live. */

const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

let known: boolean | null = null;

/** Whether this browser has no graphics processor and paints with the main one. */
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

/** Whether this browser can draw in 3D at all: what the 3D view draws with. */
export function canDrawSolid(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return gl !== null;
}

/**
 * Run `build` so that the 2D canvases it makes live in main memory. On an emulated graphics processor curves of some
 * thousand points cost about ten times as much as when they are painted there; uPlot has no option for it.
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
