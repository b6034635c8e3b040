/** Sample time between frames: lets the charts scroll evenly although samples arrive in bunches. Pure. */

const FOLLOW = 0.05;
const JUMP_S = 0.25;
/** How far the edge may run ahead of the newest sample when none arrive. */
const AHEAD_S = 0.05;

export class SampleClock {
  private offset_s: number | null = null;
  private newest_s = 0;

  /** A frame that ends at sample time `end_s` has arrived at page time `arrival_s`. */
  observe(end_s: number, arrival_s: number): void {
    const offset_s = end_s - arrival_s;
    const known = this.offset_s;
    this.offset_s =
      known === null || Math.abs(offset_s - known) > JUMP_S ? offset_s : known + FOLLOW * (offset_s - known);
    this.newest_s = end_s;
  }

  /** Sample time at page time `page_s`; stands still shortly after the newest sample. */
  at(page_s: number): number {
    if (this.offset_s === null) return 0;
    return Math.min(page_s + this.offset_s, this.newest_s + AHEAD_S);
  }

  /** Forget everything (a new connection). */
  reset(): void {
    this.offset_s = null;
    this.newest_s = 0;
  }
}
