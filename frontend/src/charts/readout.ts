/** Numbers and cursors that follow the charts, written straight into the page about ten times a second. */

import { writeAbsent, writeValue } from "../components/Absent";
import { fixed } from "../samples/format";
import type { Stretch } from "../samples/stretch";
import type { Panel } from "../theme/signals";
import type { Playhead } from "./playhead";
import type { PlotSource } from "./source";

const EVERY_MS = 100;
const GRAB_FRACTION = 0.015;
/** Why there is no value: nothing was sampled then, or what is sampled beside it is followed by no loop. */
const NO_SAMPLE = "no sample at this moment";
const NOT_IN_FORCE = "none in force at this moment";
const NOT_AT_BOTH = "not there at both cursors";

export class Readout {
  private frame: HTMLElement | null = null;
  private hovered: number | null = null;
  private cursors: [number, number] | null = null;
  private written_ms = 0;

  constructor(
    private readonly source: PlotSource,
    private readonly panels: readonly Panel[],
    private readonly playhead?: Playhead,
  ) {}

  attach(frame: HTMLElement | null): void {
    this.frame = frame;
  }

  hover(at: number | null): void {
    this.hovered = at;
    this.written_ms = 0;
  }

  measure(seen: Stretch): void {
    const span_s = seen.to_s - seen.from_s;
    this.cursors = [seen.from_s + 0.35 * span_s, seen.from_s + 0.65 * span_s];
    this.written_ms = 0;
  }

  /** The stretch between the measuring cursors, null while there are none. */
  selection(): Stretch | null {
    if (this.cursors === null) return null;
    const [a, b] = this.cursors;
    return { from_s: Math.min(a, b), to_s: Math.max(a, b) };
  }

  /** Move a cursor by a share of the stretch in sight. */
  nudge(cursor: number, by: number, span_s: number): void {
    const at_s = this.cursors?.[cursor];
    if (at_s !== undefined) this.move(cursor, at_s + by * span_s);
  }

  stopMeasuring(): void {
    this.cursors = null;
    this.written_ms = 0;
  }

  grab(at_s: number, span_s: number): number | null {
    if (this.cursors === null) return null;
    const distances = this.cursors.map((cursor) => Math.abs(cursor - at_s));
    const nearest = (distances[0] as number) <= (distances[1] as number) ? 0 : 1;
    return (distances[nearest] as number) <= GRAB_FRACTION * span_s ? nearest : null;
  }

  move(cursor: number, at_s: number): void {
    if (this.cursors === null) return;
    this.cursors = cursor === 0 ? [at_s, this.cursors[1]] : [this.cursors[0], at_s];
    this.written_ms = 0;
  }

  /** The moment that the legends tell: under the pointer, or else the newest in sight or where a recording is looked at. */
  looked(seen: Stretch): number {
    if (this.hovered === null) return this.newest(seen);
    return seen.from_s + this.hovered * (seen.to_s - seen.from_s);
  }

  /** Called after each drawn frame. */
  refresh(seen: Stretch): void {
    if (this.frame === null) return;
    const span_s = seen.to_s - seen.from_s;
    const resting = this.playhead === undefined ? null : (this.playhead.at_s - seen.from_s) / span_s;
    this.place("hover", this.hovered ?? resting);
    for (const index of [0, 1] as const) {
      const cursor = this.cursors?.[index];
      const line = this.place(
        `cursor-${index}`,
        cursor === undefined ? null : (cursor - seen.from_s) / span_s,
      );
      if (cursor !== undefined) line?.setAttribute("aria-valuenow", cursor.toFixed(3));
    }
    const now_ms = performance.now();
    if (now_ms - this.written_ms < EVERY_MS) return;
    this.written_ms = now_ms;
    this.write(seen);
  }

  private write(seen: Stretch): void {
    const at_s = this.looked(seen);
    for (const [place, panel] of this.panels.entries()) {
      const own = this.frame?.querySelector<HTMLElement>(`[data-panel="${place}"]`) ?? null;
      const measured = panel.traces.some(({ name }) => !Number.isNaN(this.source.at(name, at_s)));
      const why = measured ? NOT_IN_FORCE : NO_SAMPLE;
      for (const { name } of panel.traces) this.writeTrace(own, panel, name, at_s, why);
      if (panel.over === undefined) continue;
      const { name, factor, decimals } = panel.over;
      this.number(own, "over", factor * this.source.at(name, at_s), decimals, "", why);
    }
    if (this.cursors !== null)
      this.text(this.frame, "delta-t", `Δt ${fixed(this.cursors[1] - this.cursors[0], 3)} s`);
  }

  private writeTrace(own: HTMLElement | null, panel: Panel, name: string, at_s: number, why: string): void {
    const value = (time_s: number) => panel.factor * this.source.at(name, time_s);
    this.number(own, `value-${name}`, value(at_s), panel.decimals, "", why);
    if (this.cursors === null) return;
    const apart = value(this.cursors[1]) - value(this.cursors[0]);
    this.number(own, `delta-${name}`, apart, panel.decimals, "Δ ", NOT_AT_BOTH);
  }

  private number(
    own: HTMLElement | null,
    role: string,
    value: number,
    decimals: number,
    before: string,
    why: string,
  ): void {
    this.text(own, role, Number.isNaN(value) ? null : `${before}${fixed(value, decimals)}`, why);
  }

  /** Where a recording is looked at, or the newest sample in sight; the edge of a following view may be a little ahead of it. */
  private newest(seen: Stretch): number {
    if (this.playhead !== undefined) return this.playhead.at_s;
    return Math.min(seen.to_s, this.source.newest_s());
  }

  private place(role: string, at: number | null): HTMLElement | null {
    const line = this.frame?.querySelector<HTMLElement>(`[data-role="${role}"]`) ?? null;
    if (line === null) return null;
    const inSight = at !== null && at >= 0 && at <= 1;
    line.style.display = inSight ? "block" : "none";
    if (inSight) line.style.left = `${100 * at}%`;
    return line;
  }

  /** `text` is null where there is none; `why` says why. */
  private text(own: HTMLElement | null, role: string, text: string | null, why = ""): void {
    const element = own?.querySelector<HTMLElement>(`[data-role="${role}"]`) ?? null;
    if (element === null) return;
    if (text === null) writeAbsent(element, why);
    else writeValue(element, text);
  }
}
