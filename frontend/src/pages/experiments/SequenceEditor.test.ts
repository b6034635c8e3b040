import { describe, expect, it } from "vitest";
import { further, parseSegments, segmentsProblem, totalOf, writeSegments } from "./SequenceEditor";

describe("segments", () => {
  it("holds SI, and sends what it was given to the last digit", () => {
    const rows = parseSegments('[{"duration_s": 3, "q_ref": 0.5235987755982988, "S_ref": 11}]') ?? [];
    expect(rows[0]).toMatchObject({ shape: "step", duration_s: 3, q_ref: 0.5235987755982988, S_ref: 11 });
    expect(JSON.parse(writeSegments(rows))).toEqual([
      { duration_s: 3, q_ref: 0.5235987755982988, S_ref: 11 },
    ]);
  });

  it("sends the period of a sine only, and a push that is there", () => {
    const json = '[{"duration_s":8,"q_ref":0,"S_ref":10,"F_push":5,"shape":"sine","period_s":4}]';
    expect(JSON.parse(writeSegments(parseSegments(json) ?? []))).toEqual(JSON.parse(json));
    expect(writeSegments([{ ...further([]), shape: "ramp" }])).not.toContain("period_s");
  });

  it.each([
    ["q_ref", "5-3", "Segment 2, q_ref: “5-3” is not a number."],
    ["duration_s", "", "Segment 2, time: needs a number."],
    ["F_push", "1e", "Segment 2, push: “1e” is not a number."],
  ] as const)("keeps %s = %j as it is and says that it cannot be sent", (name, text, problem) => {
    const json = writeSegments([further([]), { ...further([]), [name]: text }]);
    const rows = parseSegments(json) ?? [];
    expect(rows[1]?.[name]).toBe(text);
    expect(segmentsProblem(json)).toBe(problem);
    expect(totalOf(rows)).toBeLessThanOrEqual(8);
    expect(segmentsProblem(writeSegments([further([])]))).toBeNull();
  });

  it("says when something is no list", () => {
    expect(parseSegments("{}")).toBeNull();
    expect(parseSegments("[{")).toBeNull();
  });
});
