import { describe, expect, it } from "vitest";
import { FORCE, PANELS, POSITION, panelsOf, STANDARD, STIFFNESS } from "../theme/layouts";
import { dashOf, type Panel } from "../theme/signals";
import {
  ComparedSource,
  comparedPanels,
  markOf,
  merged,
  type PlotSource,
  RecordedSource,
  resampled,
  ShiftedSource,
} from "./sources";

describe("compared source", () => {
  const row = (...values: number[]) => Float64Array.from(values);

  describe("merged", () => {
    it("sorts both arrays and contains each time once", () => {
      expect(Array.from(merged(row(0, 1, 3), row(0.5, 1, 4)))).toEqual([0, 0.5, 1, 3, 4]);
      expect(Array.from(merged(row(), row(2)))).toEqual([2]);
    });
  });

  describe("resampled", () => {
    it("holds the last value, and is NaN outside its own times", () => {
      const values = resampled(row(1, 2), row(10, 20), row(0, 1, 1.5, 2, 3));
      expect(Array.from(values)).toEqual([Number.NaN, 10, 10, 20, Number.NaN]);
    });
  });

  /** Source with one constant signal at its own times. */
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
    it("have a mark each, which selects the recording of a signal", () => {
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
        expect(
          Math.max(...Array.from(times).filter((_, place) => !Number.isNaN(drawn[place] as number))),
        ).toBe(index + 2);
      });
    });

    it("read the signals of one recording only from it, in any order of the traces", () => {
      const source = new ComparedSource(constant(0, [0, 1]), constant(1, [0, 1]), constant(2, [0, 1]));
      const [panel] = comparedPanels([FORCE], 2);
      if (panel === undefined) throw new Error("there is one panel");
      const { values, extents } = source.curves(panel, { from_s: 0, to_s: 1 }, 100);
      const names = panel.traces.map(({ name }) => name);
      expect(names).toEqual(["F_A", "F_A′", "F_A′′", "F_B", "F_B′", "F_B′′"]);
      expect(values.map((drawn) => drawn[0])).toEqual([0, 1, 2, 0, 1, 2]);
      expect(extents.map(({ maximum }) => maximum)).toEqual([0, 1, 2, 0, 1, 2]);
    });

    it("have the hues of the signals if there are two, the second dotted", () => {
      const further = comparedPanels([POSITION], 1)[0]?.traces.at(-1);
      expect(further?.hue).toBe(POSITION.traces[1]?.hue);
      expect(further && dashOf(further)).toEqual([2, 3]);
    });

    it("have different lines in every panel, for any number of recordings", () => {
      for (let further = 1; further < 20; further += 1) {
        for (const { traces } of comparedPanels(PANELS, further)) {
          const styles = traces.map((trace) => `${trace.hue} ${dashOf(trace)}`);
          expect(new Set(styles).size, `${further} further ones: ${styles.join("; ")}`).toBe(traces.length);
        }
      }
    });

    it("have a hue each if there are more than two, the same in all panels", () => {
      for (let further = 2; further < 20; further += 1) {
        const traces = comparedPanels(PANELS, further).flatMap((panel) => panel.traces);
        const hues = Array.from({ length: further + 1 }, (_, n) => {
          const own = traces.filter(({ name }) => name.replace(/^[^′]*/, "") === markOf(n));
          return new Set(own.map(({ hue }) => hue));
        });
        expect(hues.map(({ size }) => size)).toEqual(hues.map(() => 1));
        expect(new Set(hues.flatMap((own) => [...own])).size).toBe(further + 1);
      }
    });

    it("differ in dashes and widths without hues, up to eight", () => {
      for (const { traces } of comparedPanels(PANELS, 7)) {
        expect(new Set(traces.map((trace) => `${dashOf(trace)} ${trace.broad}`)).size).toBe(traces.length);
      }
    });

    it("differ in hue and lightness, and have contrast with light and dark backgrounds", () => {
      for (let count = 7; count <= 20; count += 1) {
        const traces = comparedPanels([STIFFNESS], count - 1)[0]?.traces.slice(1) ?? [];
        const colours = traces.map(({ hue }) => {
          const [lightness = 0, chroma = 0, angle = 0] = (hue.match(/[\d.]+/g) ?? []).map(Number);
          const radians = (angle * Math.PI) / 180;
          return [lightness, chroma * Math.cos(radians), chroma * Math.sin(radians)] as const;
        });
        for (const [place, one] of colours.entries()) {
          for (const other of colours.slice(place + 1)) {
            expect(Math.hypot(...one.map((part, axis) => part - (other[axis] ?? 0)))).toBeGreaterThan(0.08);
          }
          const luminance = one[0] ** 3;
          expect(1.05 / (luminance + 0.05)).toBeGreaterThan(2);
          expect((luminance + 0.05) / 0.062).toBeGreaterThan(2);
        }
      }
    });
  });
});

describe("shifted source", () => {
  const DURATION_S = 4;
  const POSITION = panelsOf(STANDARD)[0] as Panel;

  /** q is its own time: 0, 1, 2, 3. */
  function recording(): RecordedSource {
    const source = new RecordedSource(DURATION_S);
    const q = Float32Array.from([0, 1, 2, 3]);
    source.setOverview({
      raw: true,
      width_s: 1,
      t: Float64Array.from([0, 1, 2, 3]),
      signals: { q: { minimum: q, maximum: q } },
    });
    return source;
  }

  it("returns the values of the recording at shifted times, and NaN before and after it", () => {
    const shifted = new ShiftedSource(recording(), -1.5);
    expect([shifted.first_s(), shifted.now_s()]).toEqual([-1.5, 2.5]);
    expect(shifted.at("q", 0.5)).toBe(2);
    expect(shifted.at("q", -1.5)).toBe(0);
    expect(shifted.at("q", -1.6)).toBeNaN();
    expect(shifted.at("q", 2.6)).toBeNaN();
    const { times, values } = shifted.curves(POSITION, { from_s: -2, to_s: 3 }, 100);
    expect(Array.from(times)).toEqual([-1.5, -0.5, 0.5, 1.5]);
    expect(Array.from(values[1] ?? [])).toEqual([0, 1, 2, 3]);
    const { t, columns } = shifted.table(["q"], { from_s: -0.6, to_s: 0.6 });
    expect(Array.from(t)).toEqual([-0.5, 0.5]);
    expect(Array.from(columns[0]?.minimum ?? [])).toEqual([1, 2]);
  });
});
