import { describe, expect, it } from "vitest";
import { PROFILE_HEIGHT as HEIGHT, lineOf, placeOf, valueAt, PROFILE_WIDTH as WIDTH } from "./StepPreview";

describe("the planned profile", () => {
  it("spans the box from the lowest value at its foot to the highest at its head", () => {
    const { pieces, lowest, highest } = lineOf([0, 5, 10], [-1, 0, 1]);
    expect([lowest, highest]).toEqual([-1, 1]);
    const drawn = (pieces[0] ?? "").split(" ").map((point) => point.split(",").map(Number));
    expect(drawn.map(([x]) => x)).toEqual([0, WIDTH / 2, WIDTH]);
    expect(drawn[1]?.[1]).toBe(HEIGHT / 2);
    expect(drawn[0]?.[1]).toBeGreaterThan(drawn[2]?.[1] ?? HEIGHT);
  });

  it("is a level line where nothing changes", () => {
    expect(lineOf([0, 10], [3, 3]).pieces).toEqual([`0.0,${HEIGHT / 2}.0 ${WIDTH}.0,${HEIGHT / 2}.0`]);
  });

  it("has gaps where the plan leaves a signal open", () => {
    const { pieces, lowest, highest } = lineOf([0, 2, 4, 6, 8, 10], [null, -2, -2, null, null, 4]);
    expect([lowest, highest]).toEqual([-2, 4]);
    expect(pieces.map((piece) => piece.split(" ").length)).toEqual([2, 1]);
    expect(pieces[1]).toMatch(/^1000\.0,/);
  });

  it("tells what is asked for at an instant: what was asked for last", () => {
    const t = [0.001, 4, 4.001, 8];
    expect(placeOf(t, 3)).toBe((WIDTH * 3) / 8);
    expect([placeOf(t, 99), placeOf(t, -1)]).toEqual([WIDTH, 0]);
    expect([0, 3, 4.5, 99].map((at_s) => valueAt(t, [0, 0, 1, 2], at_s))).toEqual([0, 0, 1, 2]);
    expect(valueAt(t, [0, null, 1, 2], 4)).toBeNull();
  });
});
