/** Limits the share of time that drawing takes on a slow machine: a pause follows each slow frame. Pure. */

/** Frame duration up to which drawing continues without a pause, 30 frames per second [ms]. */
const SMOOTH_MS = 34;

/** Longest pause [ms]: a window that was hidden was not slow, and its picture must not freeze for long. */
const LONGEST_REST_MS = 2000;

export class FramePacer {
  private drawn_ms: number | null = null;
  private rest_until_ms = 0;

  /** `rest`: length of the pause as a multiple of the duration of a slow frame. */
  constructor(private readonly rest: number) {}

  /**
   * Whether to draw on this animation frame. The delay of this frame measures the duration of the last one, including
   * painting and the graphics process.
   */
  due(now_ms: number): boolean {
    // The frame of the drawing itself contains no measurement yet.
    if (this.drawn_ms !== null && now_ms > this.drawn_ms) {
      const took_ms = now_ms - this.drawn_ms;
      const rest_ms = Math.min(this.rest * took_ms, LONGEST_REST_MS);
      this.rest_until_ms = took_ms > SMOOTH_MS ? now_ms + rest_ms : 0;
      this.drawn_ms = null;
    }
    return now_ms >= this.rest_until_ms;
  }

  /** Records that a frame was drawn. */
  drew(now_ms: number): void {
    this.drawn_ms = now_ms;
  }
}

/** Passes everything that a window draws on its animation frames through a pacer. */
export function paceWindow(target: Window, pacer: FramePacer): void {
  const request = target.requestAnimationFrame.bind(target);
  target.requestAnimationFrame = (callback) =>
    request(function onFrame(now_ms) {
      if (!pacer.due(now_ms)) {
        request(onFrame);
        return;
      }
      callback(now_ms);
      pacer.drew(now_ms);
      // Measured on the next frame: a window that requests no frames for a while is idle, not slow.
      request((next_ms) => pacer.due(next_ms));
    });
}
