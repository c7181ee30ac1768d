"""What a browser is told before viser's program starts, so that the first picture is there sooner."""

from __future__ import annotations

from functools import lru_cache

from websockets.http11 import Response

SCRIPT = b"""<script>(() => {
  // Until viser hears of other lights it makes some of a photograph; the scenes here bring their own.
  const fetched = window.fetch;
  window.fetch = (what, ...how) => String(what?.url ?? what).startsWith("data:image/jpeg")
    ? new Promise(() => {}) : fetched.call(window, what, ...how);
  // Without a graphics card, smooth edges take half of the time of every picture.
  const given = HTMLCanvasElement.prototype.getContext;
  let byProcessor = false;
  HTMLCanvasElement.prototype.getContext = function (kind, how) {
    const context = given.call(this, kind, how && byProcessor ? {...how, antialias: false} : how);
    if (kind === "webgl2" && !how && context) {  // viser tries it out first
      const about = context.getExtension("WEBGL_debug_renderer_info");
      const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
      byProcessor = /swiftshader|llvmpipe|software/i.test(name);
    }
    return context;
  };
  // What is dragged over the controls selects none of their words.
  addEventListener("pointerdown", (event) => {
    if (event.target instanceof HTMLCanvasElement) document.body.style.userSelect = "none";
  }, true);
  for (const end of ["pointerup", "pointercancel"])
    addEventListener(end, () => { document.body.style.userSelect = ""; }, true);
})();</script>"""


def prepared(answer: Response) -> Response:
    """The answer to a request, with the script before all others of a page."""
    if answer.body is not None and answer.headers.get("Content-Type", "").startswith("text/html"):
        answer.body = _with_script(bytes(answer.body))
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer


@lru_cache(maxsize=1)
def _with_script(page: bytes) -> bytes:
    return page.replace(b"<script", SCRIPT + b"<script", 1)
