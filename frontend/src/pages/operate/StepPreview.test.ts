import { describe, expect, it } from "vitest";
import {
  PROFILE_HEIGHT as HEIGHT,
  lineOf,
  placeOf,
  stepPath,
  valueAt,
  PROFILE_WIDTH as WIDTH,
} from "./StepPreview";

describe("the planned profile", () => {
  it("spans the box from the lowest value at the bottom to the highest at the top", () => {
    const { pieces, lowest, highest } = lineOf([0, 5, 10], [-1, 0, 1]);
    expect([lowest, highest]).toEqual([-1, 1]);
    const drawn = (pieces[0] ?? "").split(" ").map((point) => point.split(",").map(Number));
    expect(drawn.map(([x]) => x)).toEqual([0, WIDTH / 2, WIDTH]);
    expect(drawn[1]?.[1]).toBe(HEIGHT / 2);
    expect(drawn[0]?.[1]).toBeGreaterThan(drawn[2]?.[1] ?? HEIGHT);
  });

  it("is a horizontal line for a constant signal", () => {
    expect(lineOf([0, 10], [3, 3]).pieces).toEqual([`0.0,${HEIGHT / 2}.0 ${WIDTH}.0,${HEIGHT / 2}.0`]);
  });

  it("has gaps where the program leaves a signal open", () => {
    const { pieces, lowest, highest } = lineOf([0, 2, 4, 6, 8, 10], [null, -2, -2, null, null, 4]);
    expect([lowest, highest]).toEqual([-2, 4]);
    expect(pieces.map((piece) => piece.split(" ").length)).toEqual([2, 1]);
    expect(pieces[1]).toMatch(/^1000\.0,/);
  });

  it("returns the last value at or before a time", () => {
    const t = [0.001, 4, 4.001, 8];
    expect(placeOf(t, 3)).toBe((WIDTH * 3) / 8);
    expect([placeOf(t, 99), placeOf(t, -1)]).toEqual([WIDTH, 0]);
    expect([0, 3, 4.5, 99].map((at_s) => valueAt(t, [0, 0, 1, 2], at_s))).toEqual([0, 0, 1, 2]);
    expect(valueAt(t, [0, null, 1, 2], 4)).toBeNull();
  });
});

describe("step path", () => {
  describe("stepPath", () => {
    const lam = 0.5;
    const t = Array.from({ length: 200 }, (_, k) => (8 * lam * k) / 199);
    const y = t.map((time) => 1 - (1 + time / lam) * Math.exp(-time / lam));

    it("interpolates the time to 90 % to the displayed digits", () => {
      // 1 − (1 + x) exp(−x) = 0.9 at x = 3.8897
      expect(stepPath(t, y, 150, 46).t_90).toBeCloseTo(lam * 3.8897, 3);
    });

    it("returns no time if 90 % is not reached", () => {
      expect(stepPath(t.slice(0, 90), y.slice(0, 90), 150, 46).t_90).toBeNull();
      expect(stepPath([], [], 150, 46).t_90).toBeNull();
    });
  });

  const WIDTH = 100;
  const HEIGHT = 50;

  /** A double pole at -1/lam, as the loops are designed: 90 % after 3.89 lam. */
  function response(lam: number) {
    const t = Array.from({ length: 401 }, (_, index) => (index / 400) * 8 * lam);
    return { t, y: t.map((time) => 1 - (1 + time / lam) * Math.exp(-time / lam)) };
  }

  function points(path: string): [number, number][] {
    return path
      .slice(1)
      .split("L")
      .map((pair) => pair.split(" ").map(Number) as [number, number]);
  }

  /** Returns the x at which a path first reaches a share of the final value, relative to the width. */
  function reaches(path: string, share: number, top: number): number {
    const level = HEIGHT - (share / top) * HEIGHT;
    return (points(path).find(([, y]) => y <= level)?.[0] ?? Number.NaN) / WIDTH;
  }

  it("draws two responses to scale on one time axis", () => {
    const [quick, slow] = [response(0.5), response(3)];
    const end_s = slow.t.at(-1) as number;
    for (const [lam, one] of [
      [0.5, quick],
      [3, slow],
    ] as const) {
      const drawn = stepPath(one.t, one.y, WIDTH, HEIGHT, 1.15, end_s);
      // tolerance: 0.1 units of the 24 s axis, and one point of the curve
      expect(Math.abs(reaches(drawn.path, 0.9, drawn.top) * end_s - 3.89 * lam)).toBeLessThan(0.1);
      expect(points(drawn.path).at(-1)?.[0]).toBe(WIDTH);
      expect(drawn.t_90).toBeCloseTo(3.89 * lam, 1);
    }
  });
});
