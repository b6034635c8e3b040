import { describe, expect, it } from "vitest";
import type { Limits } from "../../wire/types";
import { planeOver, pointAt, xOf, yOf } from "./planeScale";

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
  it("goes to pixels and back", () => {
    const { q, S } = pointAt(PLANE, xOf(PLANE, 0.7), yOf(PLANE, 12));
    expect(q).toBeCloseTo(0.7, 12);
    expect(S).toBeCloseTo(12, 12);
  });

  it("has the whole range in sight, stiffness upwards", () => {
    expect(xOf(PLANE, LIMITS.q_min)).toBeGreaterThan(PLANE.left);
    expect(xOf(PLANE, LIMITS.q_max)).toBeLessThan(PLANE.width);
    expect(yOf(PLANE, LIMITS.S_max)).toBeLessThan(yOf(PLANE, LIMITS.S_min));
    expect(yOf(PLANE, LIMITS.S_min)).toBeLessThan(PLANE.height - PLANE.bottom);
  });
});
