"""viser's client page, made fit for a frame of the dashboard."""

from importlib.resources import files

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'self'"
)
"""Content-Security-Policy of the scene's page: one self-contained file with inline scripts."""

# Inside a frame the client would reconnect only while the frame has the focus. Its control panel and notices are the
# dashboard's business, and the dashboard's background is to show through, so the client follows its light or dark: it
# reads that from its address, once, like the view of the camera that the dashboard asks for.
_HEAD = """<head>
<script>
  document.hasFocus = () => true
  const dashboard = parent.document.documentElement, scheme = "data-mantine-color-scheme"
  const dark = () => dashboard.getAttribute(scheme) === "dark"
  const camera = [...new URLSearchParams(location.search)].filter(([name]) => name.startsWith("initialCamera"))
  const asked = camera.map(([name, value]) => `&${name}=${value}`).join("")
  history.replaceState(null, "", (dark() ? "?hideViserLogo&darkMode" : "?hideViserLogo") + asked)
  if (parent !== window) new MutationObserver(() => location.reload()).observe(dashboard, { attributeFilter: [scheme] })
</script>
<style>
  .mantine-Paper-root, .mantine-Notifications-root { display: none !important }
  html, body, #root div { background-color: transparent !important }
</style>"""

# The dashboard says what the view waits for, so the page writes down how far it has come, and says when it changes
# (frontend/src/components/sceneStage.ts). The client's websocket lives in a worker; what that says is heard in passing.
# A connection alone is no stage, as the service may have no place: the scene is there with its first message. It is
# shown in the frame after one in which a mesh of it was drawn: the client draws some frames without any before.
# A worker's late word on a connection that is closed counts for nothing.
_STAGES = """
<script>{
  const root = document.documentElement
  const tell = (stage) => {
    if (root.dataset.stage === stage) return
    root.dataset.stage = stage
    parent.postMessage("stage", location.origin)
  }
  const nextFrame = window.requestAnimationFrame.bind(window)
  const gl = WebGL2RenderingContext.prototype, draw = gl.drawElements
  const sizes = new Set()
  const look = function (mode, count, ...rest) {
    if (sizes.has(count)) {
      gl.drawElements = draw
      nextFrame(() => { if (root.dataset.stage === "drawing") tell("shown") })
    }
    draw.call(this, mode, count, ...rest)
  }
  const tellWhenDrawn = () => { tell("drawing"); gl.drawElements = look }
  let open = false
  const heard = {
    connected: () => { open = true },
    message_batch: ({ messages }) => {
      if (!open) return
      for (const { props } of messages) if (props?.faces) sizes.add(props.faces.length)
      if (["connecting", "lost"].includes(root.dataset.stage)) tellWhenDrawn()
    },
    closed: () => { open = false; if (root.dataset.stage !== "connecting") tell("lost") },
  }
  window.Worker = class extends Worker {
    constructor(...given) {
      super(...given)
      this.addEventListener("message", ({ data }) => heard[data?.type]?.(data))
    }
  }
  addEventListener("webglcontextlost", () => tell("dropped"), true)
  addEventListener("webglcontextrestored", () => open ? tellWhenDrawn() : tell("lost"), true)
  tell("connecting")
}</script>"""


def page() -> str:
    """Return the client's page."""
    html = (files("viser") / "client" / "build" / "index.html").read_text(encoding="utf-8")
    before, head, after = html.partition("<head>")
    if not head:
        raise RuntimeError("viser's client page has no <head>: this version of viser is not known to work")
    return before + _HEAD + _STAGES + after
