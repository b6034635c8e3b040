/** Keeps drawing from taking all of a slow machine: what took long is followed by a rest. Pure. */

/** Frames of up to this length are drawn one after the other, 30 a second or better [ms]. */
const SMOOTH_MS = 34;

/** Longest rest [ms]: a window that was hidden was not slow, and its picture is not to stand still for long. */
const LONGEST_REST_MS = 2000;

export class FramePacer {
  private drawn_ms: number | null = null;
  private rest_until_ms = 0;

  /** `rest` is how many times the length of a slow frame is left to others. */
  constructor(private readonly rest: number) {}

  /**
   * Asked on each animation frame: whether to draw on this one. How long the last frame took shows in how late this one
   * comes, painting and the graphics process included.
   */
  due(now_ms: number): boolean {
    // on the frame of the drawing itself there is nothing to be measured yet
    if (this.drawn_ms !== null && now_ms > this.drawn_ms) {
      const took_ms = now_ms - this.drawn_ms;
      const rest_ms = Math.min(this.rest * took_ms, LONGEST_REST_MS);
      this.rest_until_ms = took_ms > SMOOTH_MS ? now_ms + rest_ms : 0;
      this.drawn_ms = null;
    }
    return now_ms >= this.rest_until_ms;
  }

  /** A frame was drawn. */
  drew(now_ms: number): void {
    this.drawn_ms = now_ms;
  }
}

/** Let everything that a window draws on its animation frames pass through a pacer. */
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
      // looked at on the very next frame: a window that asks for none for a while was idle, not slow
      request((next_ms) => pacer.due(next_ms));
    });
}
