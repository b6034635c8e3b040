/** Sample time between frames: lets the charts scroll evenly although samples arrive in bunches. Pure. */

const FOLLOW = 0.05;
const JUMP_S = 0.25;
/** How far the edge may run ahead of the newest sample when none arrive. */
const AHEAD_S = 0.05;
/** The way of the samples to this page may have grown longer for good, or the loop stood still: believed by and by [s/s]. */
const RELAX = 0.25;
/** A great step is believed within some of these [s]. */
const RELAX_S = 2;
/** Only while samples arrive: a silence by itself says nothing about their way. */
const LONGEST_S = 0.1;

export class SampleClock {
  private offset_s: number | null = null;
  private newest_s = 0;
  /** The shortest way that samples took of late, as what to add to the page's time; and when that was found. */
  private shortest_s: number | null = null;
  private found_s = 0;

  /** A frame that ends at sample time `end_s` has arrived at page time `arrival_s`. */
  observe(end_s: number, arrival_s: number): void {
    const offset_s = end_s - arrival_s;
    const known = this.offset_s;
    this.offset_s =
      known === null || Math.abs(offset_s - known) > JUMP_S ? offset_s : known + FOLLOW * (offset_s - known);
    this.newest_s = end_s;
    const shortest_s = this.shortest_s ?? offset_s;
    const relaxed_s =
      Math.min(arrival_s - this.found_s, LONGEST_S) * (RELAX + (shortest_s - offset_s) / RELAX_S);
    this.shortest_s = Math.max(offset_s, shortest_s - relaxed_s);
    this.found_s = arrival_s;
  }

  /** How old the newest sample is at page time `page_s`, beyond the shortest way; null before the first one [s]. */
  age(page_s: number): number | null {
    return this.shortest_s === null ? null : Math.max(0, page_s + this.shortest_s - this.newest_s);
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
    this.shortest_s = null;
  }
}
