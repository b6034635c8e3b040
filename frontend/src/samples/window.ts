/**
 * Ring buffer with the last two minutes of every signal, in typed arrays.
 *
 * The tick addresses the slot, so missed samples remain a gap (NaN) and no index is shifted. Each block of 16 ticks
 * also has its minimum and maximum, which makes drawing of long time ranges fast.
 */

import type { Frame } from "../wire/liveMessages";
import { COMBINED } from "../wire/sample.gen";
import { type DerivedSignal, valuesOf } from "./formula";

export const BLOCK_TICKS = 16;
/** Power of two above 120 s at 1 kHz. */
const CAPACITY_TICKS = 1 << 17;

export interface Column {
  readonly samples: Float32Array;
  readonly minima: Float32Array;
  readonly maxima: Float32Array;
}

/** Lengths of the joint's geometry [m]; NaN while unknown. */
interface Lengths {
  readonly r_m: number;
  readonly r_j: number;
}

/** Number of ticks for which derived signals are computed at once. */
const AT_ONCE = 4096;

const UNKNOWN: Lengths = { r_m: Number.NaN, r_j: Number.NaN };

/** Signal that is the sum of two columns, each with a sign and a length as factors. */
interface Sum {
  readonly column: Column;
  readonly terms: readonly {
    readonly of: Column;
    readonly sign: number;
    readonly length: keyof Lengths | "";
  }[];
}

export class SampleWindow {
  readonly capacity: number;
  /** Columns of the frames, in their order. */
  readonly names: readonly string[];
  columns: ReadonlyMap<string, Column>;
  /** First stored tick. */
  startTick = 0;
  /** One past the newest stored tick. */
  endTick = 0;

  private readonly ordered: readonly Column[];
  private readonly sums: readonly Sum[];
  private derived: readonly { readonly signal: DerivedSignal; readonly column: Column }[] = [];
  private readonly plain: ReadonlyMap<string, Column>;
  private lengths = UNKNOWN;

  constructor(names: readonly string[], capacity: number = CAPACITY_TICKS) {
    if (capacity % BLOCK_TICKS !== 0 || (capacity & (capacity - 1)) !== 0) {
      throw new RangeError(`capacity ${capacity} is not a power of two of at least ${BLOCK_TICKS} ticks`);
    }
    this.capacity = capacity;
    this.names = names;
    this.ordered = names.map(() => emptyColumn(capacity));
    const columns = new Map(names.map((name, index) => [name, this.ordered[index] as Column]));
    const here = COMBINED.filter(({ terms }) => terms.every(({ column }) => columns.has(column)));
    this.sums = here.map(({ terms }) => ({
      column: emptyColumn(capacity),
      terms: terms.map(({ column, sign, length }) => ({ of: columns.get(column) as Column, sign, length })),
    }));
    this.plain = new Map([
      ...columns,
      ...here.map(({ name }, index): [string, Column] => [name, (this.sums[index] as Sum).column]),
    ]);
    this.columns = this.plain;
  }

  /** Sets the geometry and recomputes the signals that depend on it. */
  measure({ r_m, r_j }: Lengths): void {
    if (r_m === this.lengths.r_m && r_j === this.lengths.r_j) return;
    this.lengths = { r_m, r_j };
    for (const sum of this.sums) this.add(sum, this.startTick);
    this.compute(this.startTick);
  }

  /** Sets the derived signals and computes them for the stored samples. */
  derive(signals: readonly DerivedSignal[]): void {
    this.derived = signals.map((signal) => ({ signal, column: emptyColumn(this.capacity) }));
    this.columns = new Map([
      ...this.plain,
      ...this.derived.map(({ signal, column }): [string, Column] => [signal.name, column]),
    ]);
    this.compute(this.startTick);
  }

  /** Number of ticks between start and end, gaps included. */
  get length(): number {
    return this.endTick - this.startTick;
  }

  /**
   * Adds a frame. A frame before the newest tick replaces the samples there (the service sends its history again
   * after a reconnection); a frame before the start of the window clears it (the control loop restarted).
   */
  append(frame: Frame): void {
    if (frame.count === 0) return;
    if (
      this.length === 0 ||
      frame.firstTick < this.startTick ||
      frame.firstTick - this.endTick >= this.capacity
    ) {
      this.startTick = frame.firstTick;
      this.endTick = frame.firstTick;
    }
    const holeFrom = Math.min(this.endTick, frame.firstTick);
    this.endTick = frame.firstTick + frame.count;
    this.startTick = Math.max(this.startTick, this.endTick - this.capacity + BLOCK_TICKS);
    for (let index = 0; index < this.ordered.length; index++) {
      const column = this.ordered[index] as Column;
      this.fill(column.samples, holeFrom, frame.firstTick);
      this.copy(column.samples, frame.columns[index] as Float32Array, frame.firstTick);
      this.summarize(column, holeFrom);
    }
    for (const sum of this.sums) this.add(sum, Math.max(holeFrom, this.startTick));
    this.compute(Math.max(holeFrom, this.startTick));
  }

  /** Value of a signal at a tick; NaN without a sample. */
  at(name: string, tick: number): number {
    const column = this.columns.get(name);
    if (column === undefined || tick < this.startTick || tick >= this.endTick) return Number.NaN;
    return column.samples[tick & (this.capacity - 1)] as number;
  }

  /** Copies the samples of a signal from `tick` on into `out`; NaN without samples. */
  copyTo(name: string, tick: number, out: Float64Array): void {
    const samples = this.columns.get(name)?.samples;
    for (let row = 0; row < out.length; row++) {
      const source = tick + row;
      const isStored = samples !== undefined && source >= this.startTick && source < this.endTick;
      out[row] = isStored ? (samples[source & (this.capacity - 1)] as number) : Number.NaN;
    }
  }

  /** Newest value of a signal; NaN before the first frame. */
  newest(name: string): number {
    return this.at(name, this.endTick - 1);
  }

  private add({ column, terms }: Sum, fromTick: number): void {
    const mask = this.capacity - 1;
    const [a, b] = terms as [Sum["terms"][number], Sum["terms"][number]];
    const [ofA, ofB, out] = [a.of.samples, b.of.samples, column.samples];
    const [timesA, timesB] = [a, b].map(
      ({ sign, length }) => sign * (length === "" ? 1 : this.lengths[length]),
    );
    for (let tick = fromTick; tick < this.endTick; tick++) {
      const slot = tick & mask;
      out[slot] = (timesA as number) * (ofA[slot] as number) + (timesB as number) * (ofB[slot] as number);
    }
    this.summarize(column, fromTick);
  }

  private compute(fromTick: number): void {
    for (let tick = fromTick; tick < this.endTick; tick += AT_ONCE) {
      const count = Math.min(AT_ONCE, this.endTick - tick);
      for (const { signal, column } of this.derived) {
        const values = valuesOf(signal.steps, count, (name) => this.given(name, tick, count), {
          ...this.lengths,
        });
        for (let row = 0; row < count; row++)
          column.samples[(tick + row) & (this.capacity - 1)] = values[row] as number;
      }
    }
    for (const { column } of this.derived) this.summarize(column, fromTick);
  }

  private given(name: string, tick: number, count: number): Float64Array {
    const values = new Float64Array(count);
    this.copyTo(name, tick, values);
    return values;
  }

  private fill(samples: Float32Array, fromTick: number, toTick: number): void {
    for (let tick = fromTick; tick < toTick; tick++) samples[tick & (this.capacity - 1)] = Number.NaN;
  }

  private copy(samples: Float32Array, values: Float32Array, firstTick: number): void {
    const tail = values.length > this.capacity ? values.subarray(values.length - this.capacity) : values;
    const slot = (firstTick + values.length - tail.length) & (this.capacity - 1);
    const head = Math.min(tail.length, this.capacity - slot);
    samples.set(tail.subarray(0, head), slot);
    samples.set(tail.subarray(head), 0);
  }

  private summarize(column: Column, fromTick: number): void {
    const blocks = this.capacity / BLOCK_TICKS;
    const firstBlock = Math.floor(Math.max(fromTick, this.startTick) / BLOCK_TICKS);
    for (let block = firstBlock; block * BLOCK_TICKS < this.endTick; block++) {
      const from = Math.max(block * BLOCK_TICKS, this.startTick);
      const to = Math.min((block + 1) * BLOCK_TICKS, this.endTick);
      let minimum = Number.POSITIVE_INFINITY;
      let maximum = Number.NEGATIVE_INFINITY;
      for (let tick = from; tick < to; tick++) {
        const value = column.samples[tick & (this.capacity - 1)] as number;
        if (value < minimum) minimum = value;
        if (value > maximum) maximum = value;
      }
      const empty = maximum < minimum;
      column.minima[block & (blocks - 1)] = empty ? Number.NaN : minimum;
      column.maxima[block & (blocks - 1)] = empty ? Number.NaN : maximum;
    }
  }
}

function emptyColumn(capacity: number): Column {
  const blocks = capacity / BLOCK_TICKS;
  return {
    samples: new Float32Array(capacity).fill(Number.NaN),
    minima: new Float32Array(blocks).fill(Number.NaN),
    maxima: new Float32Array(blocks).fill(Number.NaN),
  };
}
