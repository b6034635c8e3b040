/** Writes numbers and cursors of the charts directly into the page, about ten times per second. */

import { writeAbsent, writeValue } from "../components/values";
import { fixed } from "../samples/format";
import type { TimeRange } from "../samples/timeSeries";
import type { Panel } from "../theme/signals";
import { marksNear, type PlacedMark } from "./decorations";
import type { PlotSource } from "./sources";
import { type StoredData, StoredMoments } from "./storedRuns";
import { TEXTS } from "./texts";
import type { Playhead } from "./viewport";

const EVERY_MS = 100;
const GRAB_FRACTION = 0.015;
/** Reasons for a missing value: no sample at this time, or a signal that no loop currently follows. */
const NO_SAMPLE = TEXTS.noSample;
const NOT_ACTIVE = TEXTS.notActive;
const NOT_AT_BOTH = TEXTS.notAtBoth;
const LOADING = TEXTS.loading;
/** Distance from the pointer within which the text of a mark is shown [CSS px]. */
const NEAR_PX = 6;
/**
 * Shares of the width beyond which a text is left of its line; the time under the pointer avoids those of the
 * cursors.
 */
const TO_THE_LEFT = { hover: 0.1, cursor: 0.85, marks: 0.7 };
/** Prefix of the middle of a bucket's smallest and largest value, when the sample is not loaded. */
const ABOUT = "≈ ";

/** Value of one sample or approximate value, or the reason why there is none. */
interface CursorValue {
  readonly value: number;
  readonly about: boolean;
  readonly why: string;
}

export class Readout {
  private frame: HTMLElement | null = null;
  private hovered: number | null = null;
  private cursors: [number, number] | null = null;
  private written_ms = 0;
  private marks: readonly PlacedMark[] = [];
  private readonly moments: StoredMoments | null;

  constructor(
    private readonly source: PlotSource,
    private readonly panels: readonly Panel[],
    private readonly timeText: (time_s: number) => string,
    stored: StoredData | null = null,
    private readonly playhead?: Playhead,
  ) {
    const drawn = panels.flatMap(({ traces, over }) => [...traces, ...(over === undefined ? [] : [over])]);
    const names = [...new Set(drawn.map(({ name }) => name))];
    this.moments = stored === null ? null : new StoredMoments(stored, names);
  }

  close(): void {
    this.moments?.close();
  }

  setMarks(marks: readonly PlacedMark[]): void {
    this.marks = marks;
  }

  attach(frame: HTMLElement | null): void {
    this.frame = frame;
  }

  hover(at: number | null): void {
    this.hovered = at;
    this.written_ms = 0;
  }

  measure(seen: TimeRange): void {
    const span_s = seen.to_s - seen.from_s;
    this.cursors = [seen.from_s + 0.35 * span_s, seen.from_s + 0.65 * span_s];
    this.written_ms = 0;
  }

  /** Range between the measuring cursors; null without them. */
  selection(): TimeRange | null {
    if (this.cursors === null) return null;
    const [a, b] = this.cursors;
    return { from_s: Math.min(a, b), to_s: Math.max(a, b) };
  }

  /** Moves a cursor by a share of the visible range. */
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

  /**
   * Time of the legends' values: under the pointer, otherwise the newest visible one, or the playhead of a recording.
   */
  readoutTime(seen: TimeRange): number {
    if (this.hovered === null) return this.newest(seen);
    return seen.from_s + this.hovered * (seen.to_s - seen.from_s);
  }

  /** Called after each drawn frame. */
  refresh(seen: TimeRange): void {
    if (this.frame === null) return;
    const span_s = seen.to_s - seen.from_s;
    const resting = this.playhead === undefined ? null : (this.playhead.at_s - seen.from_s) / span_s;
    const line = this.place("hover", this.hovered ?? resting);
    if (line !== null) {
      this.label(line, "hover-time", this.timeText(this.readoutTime(seen)), TO_THE_LEFT.hover);
      const near = this.hovered === null ? "" : this.nearbyMarks(line, this.readoutTime(seen), span_s);
      this.label(line, "marks", near, TO_THE_LEFT.marks);
    }
    for (const index of [0, 1] as const) {
      const cursor = this.cursors?.[index];
      const line = this.place(
        `cursor-${index}`,
        cursor === undefined ? null : (cursor - seen.from_s) / span_s,
      );
      if (cursor === undefined || line === null) continue;
      line.setAttribute("aria-valuenow", cursor.toFixed(3));
      this.label(line, `cursor-${index}-time`, `${index + 1}  ${this.timeText(cursor)}`, TO_THE_LEFT.cursor);
    }
    const now_ms = performance.now();
    if (now_ms - this.written_ms < EVERY_MS) return;
    this.written_ms = now_ms;
    this.write(seen);
  }

  /** Texts of the events near the pointer, each with its time. */
  private nearbyMarks(line: HTMLElement, at_s: number, span_s: number): string {
    const perPixel_s = span_s / Math.max(1, line.parentElement?.clientWidth ?? 1);
    return marksNear(this.marks, at_s, NEAR_PX * perPixel_s)
      .map(({ time_s, text }) => `${this.timeText(time_s)}  ${text}`)
      .join("\n");
  }

  private label(line: HTMLElement, role: string, text: string, leftFrom: number): void {
    const element = line.querySelector<HTMLElement>(`[data-role="${role}"]`);
    if (element === null) return;
    if (element.textContent !== text) element.textContent = text;
    element.hidden = text === "";
    const left = Number.parseFloat(line.style.left) > 100 * leftFrom;
    element.toggleAttribute("data-left", left);
  }

  private write(seen: TimeRange): void {
    const at_s = this.readoutTime(seen);
    this.moments?.want([at_s, ...(this.cursors ?? [])].filter((time_s) => !this.isHere(time_s)));
    for (const [place, panel] of this.panels.entries()) {
      const own = this.frame?.querySelector<HTMLElement>(`[data-panel="${place}"]`) ?? null;
      for (const { name } of panel.traces) this.writeTrace(own, panel, name, at_s);
      if (panel.over === undefined) continue;
      const { name, factor, decimals } = panel.over;
      this.writeValueAt(own, "over", scaled(this.valueAt(panel, name, at_s), factor), decimals);
    }
    if (this.cursors !== null)
      this.text(this.frame, "delta-t", `Δt ${fixed(this.cursors[1] - this.cursors[0], 3)} s`);
  }

  private writeTrace(own: HTMLElement | null, panel: Panel, name: string, at_s: number): void {
    const { factor, decimals } = panel;
    if (this.cursors === null) {
      this.writeValueAt(own, `value-${name}`, scaled(this.valueAt(panel, name, at_s), factor), decimals);
      return;
    }
    const [a, b] = this.cursors.map((time_s) => scaled(this.cursorValue(panel, name, time_s), factor)) as [
      CursorValue,
      CursorValue,
    ];
    this.writeValueAt(own, `cursor-0-${name}`, a, decimals, "1: ");
    this.writeValueAt(own, `cursor-1-${name}`, b, decimals, "2: ");
    const why = [a.why, b.why].find((reason) => reason === LOADING) ?? NOT_AT_BOTH;
    const difference = { value: b.value - a.value, about: a.about || b.about, why };
    this.writeValueAt(own, `delta-${name}`, difference, decimals, "Δ ");
  }

  /** Sample at or before a time; for a recording an approximate value until the sample is loaded. */
  private valueAt(panel: Panel, name: string, time_s: number): CursorValue {
    const here = this.isHere(time_s);
    const exact = here ? null : (this.moments?.at(name, time_s) ?? null);
    return this.withReason(panel, time_s, exact ?? this.source.at(name, time_s), !here && exact === null);
  }

  /** Value at a measuring cursor: shows no approximate value while the sample loads. */
  private cursorValue(panel: Panel, name: string, time_s: number): CursorValue {
    if (this.isHere(time_s) || this.moments === null) return this.valueAt(panel, name, time_s);
    const value = this.moments.at(name, time_s);
    if (value !== null) return this.withReason(panel, time_s, value, false);
    return { value: Number.NaN, about: false, why: this.moments.problem || LOADING };
  }

  private withReason(panel: Panel, time_s: number, value: number, about: boolean): CursorValue {
    if (!Number.isNaN(value)) return { value, about, why: "" };
    const measured = panel.traces.some(({ name }) => !Number.isNaN(this.source.at(name, time_s)));
    return { value, about, why: measured ? NOT_ACTIVE : NO_SAMPLE };
  }

  private isHere(time_s: number): boolean {
    return this.source.exactAt?.(time_s) ?? true;
  }

  private writeValueAt(
    own: HTMLElement | null,
    role: string,
    { value, about, why }: CursorValue,
    decimals: number,
    before = "",
  ) {
    const text = Number.isNaN(value) ? null : `${before}${about ? ABOUT : ""}${fixed(value, decimals)}`;
    this.text(own, role, text, why);
  }

  /**
   * Playhead of a recording, or the newest visible sample; the edge of a following view may be slightly ahead of it.
   */
  private newest(seen: TimeRange): number {
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

  /** Writes `text`; null writes the dash with the reason `why`. */
  private text(own: HTMLElement | null, role: string, text: string | null, why = ""): void {
    const element = own?.querySelector<HTMLElement>(`[data-role="${role}"]`) ?? null;
    if (element === null) return;
    if (text === null) writeAbsent(element, why);
    else writeValue(element, text);
  }
}

function scaled({ value, ...rest }: CursorValue, factor: number): CursorValue {
  return { ...rest, value: factor * value };
}
