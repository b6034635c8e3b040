import { describe, expect, it } from "vitest";
import type { Surface } from "../../charts/canvas";
import { SampleWindow } from "../../samples/window";
import type { Limits } from "../../wire/types";
import { type PlaneEntry, type PlannedPath, paintPlane, planeOver, pointAt, xOf, yOf } from "./operatingMap";

describe("plane scale", () => {
  const LIMITS = {
    q_min: -1.4,
    q_max: 1.4,
    q_trip: 1.57,
    S_min: 8,
    S_max: 15,
    tensions: [
      { F: 1, S: 5.4 },
      { F: 50, S: 15.5 },
    ],
  } as Limits;
  const PLANE = planeOver(LIMITS, 300, 200);

  describe("the plane of position and stiffness", () => {
    it("converts to pixels and back", () => {
      const { q, S } = pointAt(PLANE, xOf(PLANE, 0.7), yOf(PLANE, 12));
      expect(q).toBeCloseTo(0.7, 12);
      expect(S).toBeCloseTo(12, 12);
    });

    it("shows the whole range, with stiffness upwards", () => {
      expect(xOf(PLANE, LIMITS.q_min)).toBeGreaterThan(PLANE.left);
      expect(xOf(PLANE, LIMITS.q_max)).toBeLessThan(PLANE.width);
      expect(yOf(PLANE, LIMITS.S_max)).toBeLessThan(yOf(PLANE, LIMITS.S_min));
      expect(yOf(PLANE, LIMITS.S_min)).toBeLessThan(PLANE.height - PLANE.bottom);
    });
  });
});

describe("paint plane", () => {
  const LIMITS = {
    q_min: -1.4,
    q_max: 1.4,
    q_trip: 1.57,
    S_min: 8,
    S_max: 15,
    tensions: [
      { F: 1, S: 5.6 },
      { F: 50, S: 15.6 },
    ],
  } as unknown as Limits;
  const SIZE = { width: 300, height: 190 };
  const PLANE = planeOver(LIMITS, SIZE.width, SIZE.height);
  const PLANNED: PlannedPath = {
    q_low: -0.02,
    q_high: 0.57,
    path: [
      { q: 0, S: 8.24 },
      { q: 0.25, S: 9.4 },
      { q: 0.52, S: 10.9 },
    ],
  };

  type Call = readonly [string, ...unknown[]];

  /** Returns the calls on the drawing context, in order. */
  function drawn(entries: readonly PlaneEntry[], planned: PlannedPath | null): Call[] {
    const calls: Call[] = [];
    const pen = new Proxy({} as Record<string, unknown>, {
      get:
        (_target, name) =>
        (...values: unknown[]) =>
          calls.push([String(name), ...values]),
      set: () => true,
    });
    const surface = { ...SIZE, context: pen, colours: { drawn: (hue: string) => hue } } as unknown as Surface;
    paintPlane(surface, LIMITS, undefined, new SampleWindow(["q", "S"], 16), entries, null, "deg", planned);
    return calls;
  }

  it("draws the planned path of a run through each of its points, and the band of its positions", () => {
    const calls = drawn([], PLANNED);
    const points = PLANNED.path.map(({ q, S }) => ["lineTo", xOf(PLANE, q), yOf(PLANE, S)]);
    const first = calls.findIndex((call) => JSON.stringify(call) === JSON.stringify(points[0]));
    expect(calls.slice(first, first + 4)).toEqual([...points, ["stroke"]]);
    const bands = calls.filter(([name, x]) => name === "fillRect" && x === xOf(PLANE, PLANNED.q_low));
    expect(bands).toHaveLength(1);
    expect(bands[0]?.[3]).toBeCloseTo(xOf(PLANE, PLANNED.q_high) - xOf(PLANE, PLANNED.q_low), 9);
  });

  it.each([
    { q: 0.47, x: xOf(PLANE, 0.47), finished: "fill" },
    { q: null, x: PLANE.left, finished: "stroke" },
  ])("draws an operating point at its position, hollow on the S axis if that is unknown: $q", (entry) => {
    const calls = drawn([{ S: 10.55, q: entry.q }], null);
    const start = calls.findIndex(([name, , y]) => name === "moveTo" && y === yOf(PLANE, 10.55));
    const diamond = calls.slice(start, start + 6);
    expect(diamond.map(([name]) => name)).toEqual([
      "moveTo",
      ...Array<string>(3).fill("lineTo"),
      "closePath",
      entry.finished,
    ]);
    const corners = diamond.slice(0, 4).map(([, x, y]) => [x as number, y as number] as const);
    expect(corners.reduce((sum, [x]) => sum + x, 0) / 4).toBeCloseTo(entry.x, 9);
    expect(corners.reduce((sum, [, y]) => sum + y, 0) / 4).toBeCloseTo(yOf(PLANE, 10.55), 9);
  });
});
