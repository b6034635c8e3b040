import { describe, expect, it } from "vitest";
import { further, parseSegments, writeSegments } from "./segments";

describe("segments", () => {
  it("shows degrees and sends radians", () => {
    const rows = parseSegments('[{"duration_s": 3, "q_ref": 0.5235987755982988, "S_ref": 11}]') ?? [];
    expect(rows[0]).toMatchObject({ shape: "step", duration_s: 3, q_ref_deg: 30, S_ref: 11 });
    expect(JSON.parse(writeSegments(rows))).toEqual([
      { duration_s: 3, q_ref: expect.closeTo(0.5235988, 6), S_ref: 11 },
    ]);
  });

  it("sends the period of a sine only, and a push that is there", () => {
    const json = '[{"duration_s":8,"q_ref":0,"S_ref":10,"F_push":5,"shape":"sine","period_s":4}]';
    expect(JSON.parse(writeSegments(parseSegments(json) ?? []))).toEqual(JSON.parse(json));
    expect(writeSegments([{ ...further([]), shape: "ramp" }])).not.toContain("period_s");
  });

  it("says when something is no list", () => {
    expect(parseSegments("{}")).toBeNull();
    expect(parseSegments("[{")).toBeNull();
  });
});
