/** Values at single moments that only the service has: asked for once the moments have come to rest. */

import type { Moment, StoredData } from "./stored";

export class StoredMoments {
  private readonly found = new Map<number, Moment>();
  private wanted = "";
  private asked = "";
  private leave = new AbortController();
  private failed = "";

  constructor(
    private readonly stored: StoredData,
    private readonly names: readonly string[],
  ) {}

  /** Why the values of the moments wanted last are not there; "" where they are, or are on their way. */
  get problem(): string {
    return this.failed;
  }

  /** Called time and again: what is wanted twice in a row is asked for; values of other moments are forgotten. */
  want(times_s: readonly number[]): void {
    const missing = times_s.filter((time_s) => !this.found.has(time_s));
    const key = missing.join(" ");
    const rested = key === this.wanted;
    this.wanted = key;
    if (key === "" || !rested || key === this.asked) return;
    this.asked = key;
    this.failed = "";
    this.leave.abort();
    this.leave = new AbortController();
    const { signal } = this.leave;
    this.stored
      .values(this.names, missing, signal)
      .then((moments) => {
        if (signal.aborted) return;
        for (const known of [...this.found.keys()]) if (!times_s.includes(known)) this.found.delete(known);
        for (const [n, moment] of moments.entries()) this.found.set(missing[n] as number, moment);
        this.asked = "";
      })
      .catch((error: Error) => {
        if (!signal.aborted) this.failed = error.message;
      });
  }

  /** A value in SI, NaN where there is none; null where it is not here. */
  at(name: string, time_s: number): number | null {
    const moment = this.found.get(time_s);
    return moment === undefined ? null : (moment.get(name) ?? Number.NaN);
  }

  /** Ask for nothing any more. */
  close(): void {
    this.leave.abort();
  }
}
