"""viser's client page, made fit for a frame of the dashboard."""

from importlib.resources import files

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'self'"
)
"""Content-Security-Policy of the scene's page: one self-contained file with inline scripts."""

# Inside a frame the client would reconnect only while the frame has the focus. Its control panel and notices are the
# dashboard's business, and the dashboard's background is to show through, so the client follows its light or dark: it
# reads that from its address, once, like the view of the camera that the dashboard asks for. Without a graphics card a
# picture takes long, and the client would draw one after the other and leave the dashboard no time: after a slow
# picture it rests three times as long.
_HEAD = """<head>
<script>
  document.hasFocus = () => true
  const dashboard = parent.document.documentElement, scheme = "data-mantine-color-scheme"
  const dark = () => dashboard.getAttribute(scheme) === "dark"
  const camera = [...new URLSearchParams(location.search)].filter(([name]) => name.startsWith("initialCamera"))
  const asked = camera.map(([name, value]) => `&${name}=${value}`).join("")
  history.replaceState(null, "", (dark() ? "?hideViserLogo&darkMode" : "?hideViserLogo") + asked)
  const nextFrame = window.requestAnimationFrame.bind(window)
  let restUntil = 0
  window.requestAnimationFrame = (draw) => nextFrame(function look(now) {
    if (now < restUntil) return nextFrame(look)
    nextFrame((next) => { if (next - now > 50) restUntil = next + Math.min(3 * (next - now), 1000) })
    draw(now)
  })
  if (parent !== window) new MutationObserver(() => location.reload()).observe(dashboard, { attributeFilter: [scheme] })
</script>
<style>
  .mantine-Paper-root, .mantine-Notifications-root { display: none !important }
  html, body, #root div { background-color: transparent !important }
</style>"""


def page() -> str:
    """Return the client's page."""
    html = (files("viser") / "client" / "build" / "index.html").read_text(encoding="utf-8")
    before, head, after = html.partition("<head>")
    if not head:
        raise RuntimeError("viser's client page has no <head>: this version of viser is not known to work")
    return before + _HEAD + after
