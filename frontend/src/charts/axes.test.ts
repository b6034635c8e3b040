import { describe, expect, it } from "vitest";
import { clockTime } from "../samples/format";
import {
  decadeRange,
  logLabels,
  printedTime,
  roundStep,
  splitsOf,
  steadyRange,
  stepFor,
  tickLabels,
  timeText,
  timeTitle,
} from "./axes";
import { TEXTS } from "./texts";

describe("range", () => {
  const BEFORE = { min: -10, max: 10 };

  describe("steadyRange", () => {
    it("does not change while the curves fit and use enough of it", () => {
      expect(steadyRange(BEFORE, { minimum: -4, maximum: 7 }, 1)).toBe(BEFORE);
    });

    it("widens at once and includes all values", () => {
      const range = steadyRange(BEFORE, { minimum: -4, maximum: 33 }, 1);
      expect(range.min).toBeLessThanOrEqual(-4);
      expect(range.max).toBeGreaterThanOrEqual(33);
    });

    it("narrows when most of it is unused, but not below the minimum height", () => {
      const range = steadyRange(BEFORE, { minimum: 1, maximum: 1.001 }, 2);
      expect(range.max - range.min).toBeGreaterThanOrEqual(2);
      expect(range.max - range.min).toBeLessThan(6);
      expect(steadyRange(range, { minimum: 1, maximum: 1.002 }, 2)).toBe(range);
    });

    it("moves a flat curve away from the edge, and then does not change", () => {
      // 30 degrees held, on an axis that a step from 22 produced
      const before = { min: 22, max: 30 };
      const range = steadyRange(before, { minimum: 30, maximum: 30 }, 4);
      const share = (30 - range.min) / (range.max - range.min);
      expect(share).toBeGreaterThan(0.25);
      expect(share).toBeLessThan(0.75);
      expect(steadyRange(range, { minimum: 29.98, maximum: 30.02 }, 4)).toBe(range);
      // a curve that uses the whole axis may touch its ends
      expect(steadyRange(before, { minimum: 22, maximum: 30 }, 4)).toBe(before);
    });

    it("does not change without values", () => {
      const nothing = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
      expect(steadyRange(BEFORE, nothing, 1)).toBe(BEFORE);
    });
  });

  it("rounds steps up to 1, 2, 5 times a power of ten", () => {
    expect([0.9, 1, 1.1, 2.4, 7, 0.03].map(roundStep)).toEqual([1, 1, 2, 5, 10, 0.05]);
  });

  describe("the decades of a logarithmic axis", () => {
    it("include all values, in whole powers of ten", () => {
      const [low, high] = decadeRange(0.02, 3);
      expect([low, high]).toEqual([0.01, 10]);
    });

    it("omit rounding errors, and exist without values", () => {
      const [low, high] = decadeRange(1e-40, 1);
      expect(high / low).toBeCloseTo(1e12, -3);
      for (const [min, max] of [
        [null, null],
        [0, 0],
        [5, 5],
        [1, 1],
      ] as const) {
        const range = decadeRange(min, max);
        expect(range[1] / range[0]).toBeGreaterThan(9);
        expect(Number.isFinite(range[1])).toBe(true);
      }
    });
  });
});

describe("ticks", () => {
  /** Value of a label as a person reads it. */
  function read(label: string): number {
    return Number(label.replaceAll("−", "-"));
  }

  /** Distances that uPlot chooses from: 1, 2, 2.5 and 5 times a power of ten. */
  const STEPS = [-9, -6, -4, -3, -2, -1, 0, 1, 2, 5, 8].flatMap((power) =>
    [1, 2, 2.5, 5].map((digit) => Number(`${digit}e${power}`)),
  );

  describe("labels of an axis", () => {
    it("state the value of the grid line, for every distance of the lines", () => {
      for (const step of STEPS) {
        for (const first of [-12, -3, 0, 1, 39]) {
          const splits = [0, 1, 2, 3, 4].map((index) => (first + index) * step);
          const labels = tickLabels(splits, step);
          for (const [index, label] of labels.entries())
            expect(Math.abs(read(label) - (splits[index] as number)), `${label} by ${step}`).toBeLessThan(
              1e-6 * step,
            );
          expect(new Set(labels).size).toBe(5);
        }
      }
    });

    it("have equal and minimal numbers of decimals", () => {
      expect(tickLabels([6.25, 6.5, 6.75, 7, 7.25, 7.5], 0.25)).toEqual([
        "6.25",
        "6.50",
        "6.75",
        "7.00",
        "7.25",
        "7.50",
      ]);
      expect(tickLabels([-10, -7.5, -5, -2.5, 0], 2.5)).toEqual(["−10.0", "−7.5", "−5.0", "−2.5", "0.0"]);
      expect(tickLabels([8, 10], 2)).toEqual(["8", "10"]);
    });

    it("are short for very small and very large numbers", () => {
      expect(tickLabels([2.5e-7, 5e-7], 2.5e-7)).toEqual(["2.5e−7", "5.0e−7"]);
      expect(tickLabels([1.25e8, 1.5e8], 2.5e7)).toEqual(["1.25e8", "1.50e8"]);
    });

    it("state the value of a logarithmic grid line, and omit lines that the chart omits", () => {
      expect(logLabels([0.001, null, 0.1, 0.2, 1, 10, 1000, 1e5, 2e-6])).toEqual([
        "0.001",
        "",
        "0.1",
        "0.2",
        "1",
        "10",
        "1000",
        "1e5",
        "2e−6",
      ]);
      for (const power of [-12, -5, -4, -3, -1, 0, 3, 4, 9])
        for (const digit of [1, 2, 3, 5, 7]) {
          const value = digit * 10 ** power;
          expect(read(logLabels([value])[0] as string) / value).toBeCloseTo(1, 9);
        }
    });
  });

  it("writes times with the resolution of the lines", () => {
    for (const step of [0.001, 0.0025, 0.025, 0.05, 0.25, 0.5, 2.5, 15]) {
      for (const count of [1, 2, 3, 5, 41]) {
        const [minutes, seconds] = clockTime(count * step, step)
          .split(":")
          .map(read) as [number, number];
        expect(60 * minutes + seconds).toBeCloseTo(count * step, 6);
      }
    }
  });
});

describe("time axis", () => {
  it("has lines at round times since the start", () => {
    expect(splitsOf(-0.5, 10.2, 5, null)).toEqual([0, 5, 10]);
    expect(splitsOf(2, 2.001, 5, null)).toEqual([]);
  });

  it.each([1, 5, 15, 60, 300])("has lines at round times of the day, %d s apart", (step_s) => {
    const epoch_s = new Date(2026, 2, 1, 14, 5, 9, 370).getTime() / 1000;
    const splits = splitsOf(0, 5 * step_s, step_s, epoch_s);
    expect(splits.length).toBeGreaterThanOrEqual(5);
    for (const split of splits) {
      const when = new Date(1000 * (epoch_s + split));
      const seconds = 3600 * when.getHours() + 60 * when.getMinutes() + when.getSeconds();
      expect(Math.abs(when.getMilliseconds() - 500)).toBeGreaterThan(497);
      expect((seconds + (when.getMilliseconds() > 500 ? 1 : 0)) % step_s).toBe(0);
    }
  });

  it("formats a time as time since the start, or as time of day", () => {
    const epoch_s = new Date(2026, 2, 1, 14, 5, 9).getTime() / 1000;
    expect(timeText(61.5, 0.1, null)).toBe("1:01.5");
    expect(timeText(61.5, 0.1, epoch_s)).toBe("14:06:10.5");
  });

  it("is printed in seconds with their unit, or as the time of day", () => {
    const epoch_s = new Date(2026, 2, 1, 14, 5, 9).getTime() / 1000;
    expect([printedTime(605, 5, null), timeTitle(null)]).toEqual(["605", TEXTS.timeSinceStart]);
    expect(printedTime(-0.25, 0.05, null)).toBe("−0.25");
    expect([printedTime(61.5, 0.1, epoch_s), timeTitle(epoch_s)]).toEqual(["14:06:10.5", TEXTS.timeOfDay]);
  });

  it("takes the smallest distance with space for the labels", () => {
    expect(stepFor(20, 700, 70)).toBe(2);
    expect(stepFor(20, 690, 70)).toBe(5);
  });
});
