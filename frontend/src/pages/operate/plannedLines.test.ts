import { describe, expect, it } from "vitest";
import { HEIGHT, lineOf, momentOf, WIDTH } from "./plannedLines";

describe("the planned profile", () => {
  it("spans the box from the lowest value at its foot to the highest at its head", () => {
    const { points, lowest, highest } = lineOf([0, 5, 10], [-1, 0, 1]);
    expect([lowest, highest]).toEqual([-1, 1]);
    const drawn = points.split(" ").map((point) => point.split(",").map(Number));
    expect(drawn.map(([x]) => x)).toEqual([0, WIDTH / 2, WIDTH]);
    expect(drawn[1]?.[1]).toBe(HEIGHT / 2);
    expect(drawn[0]?.[1]).toBeGreaterThan(drawn[2]?.[1] ?? HEIGHT);
  });

  it("is a level line where nothing changes", () => {
    expect(lineOf([0, 10], [3, 3]).points).toBe(`0.0,${HEIGHT / 2}.0 ${WIDTH}.0,${HEIGHT / 2}.0`);
  });

  it("tells what is asked for at an instant: what was asked for last", () => {
    const planned = { t: [0.001, 4, 4.001, 8], q_ref: [0, 0, 1, 1], S_ref: [10, 10, 10, 12], parts: [] };
    expect(momentOf(planned, 3)).toEqual({ x: (WIDTH * 3) / 8, q_ref: 0, S_ref: 10 });
    expect(momentOf(planned, 4.5).q_ref).toBe(1);
    expect(momentOf(planned, 99)).toEqual({ x: WIDTH, q_ref: 1, S_ref: 12 });
    expect(momentOf(planned, 0).q_ref).toBe(0);
  });
});
