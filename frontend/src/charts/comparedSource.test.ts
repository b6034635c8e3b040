import { describe, expect, it } from "vitest";
import { POSITION } from "../theme/signals";
import { ComparedSource, comparedPanels, markOf, merged, resampled } from "./comparedSource";
import type { PlotSource } from "./source";

const row = (...values: number[]) => Float64Array.from(values);

describe("merged", () => {
  it("keeps both rows in order and each time once", () => {
    expect(Array.from(merged(row(0, 1, 3), row(0.5, 1, 4)))).toEqual([0, 0.5, 1, 3, 4]);
    expect(Array.from(merged(row(), row(2)))).toEqual([2]);
  });
});

describe("resampled", () => {
  it("holds the last value and draws nothing outside its own times", () => {
    const values = resampled(row(1, 2), row(10, 20), row(0, 1, 1.5, 2, 3));
    expect(Array.from(values)).toEqual([Number.NaN, 10, 10, 20, Number.NaN]);
  });
});

/** A source with one constant signal at times of its own. */
function constant(value: number, times: number[]): PlotSource {
  return {
    now_s: () => times.at(-1) ?? 0,
    newest_s: () => times.at(-1) ?? 0,
    first_s: () => 0,
    version: () => 1,
    changedWithin: () => false,
    curves: (panel) => ({
      times: row(...times),
      values: panel.traces.map(() => row(...times.map(() => value))),
      extents: panel.traces.map(() => ({ minimum: value, maximum: value })),
    }),
    at: (name) => (name === "q" ? value : Number.NaN),
    table: () => {
      throw new Error("not asked for");
    },
  };
}

describe("several recordings", () => {
  it("have a mark each, by which each signal is read from its own", () => {
    const sources = Array.from({ length: 12 }, (_, index) => constant(index, [0, 1 + index]));
    const source = new ComparedSource(...sources);
    expect([1, 2, 3, 4, 11].map(markOf)).toEqual(["′", "′′", "′′′", "′⁴", "′¹¹"]);
    for (let n = 1; n < 12; n += 1) expect(source.at(`q${markOf(n)}`, 0)).toBe(n);
    expect(source.at("q", 0)).toBe(0);
    expect(source.now_s()).toBe(12);
    const [panel] = comparedPanels([POSITION], 11);
    if (panel === undefined) throw new Error("there is one panel");
    const { times, values } = source.curves(panel, { from_s: 0, to_s: 12 }, 100);
    expect(values.length).toBe(panel.traces.length);
    const own = POSITION.traces.length;
    values.slice(own).forEach((drawn, index) => {
      const there = Array.from(drawn).filter((value) => !Number.isNaN(value));
      expect(new Set(there)).toEqual(new Set([index + 1]));
      expect(Math.max(...Array.from(times).filter((_, place) => !Number.isNaN(drawn[place] as number)))).toBe(
        index + 2,
      );
    });
  });

  it("keep the hue where there are two, and have one each where there are more", () => {
    const hues = (count: number) =>
      comparedPanels([POSITION], count)[0]?.traces.slice(POSITION.traces.length);
    expect(hues(1)?.map(({ hue, dotted }) => [hue, dotted])).toEqual([[POSITION.traces[1]?.hue, true]]);
    expect(new Set(hues(4)?.map(({ hue }) => hue)).size).toBe(4);
  });
});
