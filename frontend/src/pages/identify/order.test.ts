import { describe, expect, it } from "vitest";
import type { IdentificationKind } from "../../wire/types";
import { requestOf } from "./order";

const ACTUATOR: IdentificationKind = { kind: "actuator", title: "Actuator", description: "", settings: [] };

describe("requestOf", () => {
  it("asks for what was changed, and for nothing else", () => {
    expect(requestOf(ACTUATOR, { tension_N: 30 }, "")).toEqual({
      request: { kind: "actuator", tension_N: 30 },
      problem: null,
    });
  });

  it("takes several tensions from a list", () => {
    expect(requestOf(ACTUATOR, {}, " 10, 20;30 40 ").request).toEqual({
      kind: "actuator",
      tensions_N: [10, 20, 30, 40],
    });
  });

  it("says what is no number instead of asking", () => {
    expect(requestOf(ACTUATOR, { chip_s: "" }, "")).toMatchObject({
      request: null,
      problem: expect.stringContaining("chip_s"),
    });
    expect(requestOf(ACTUATOR, {}, "10, twenty")).toMatchObject({ request: null });
    expect(requestOf(ACTUATOR, {}, "8 9 10 11 12 13 14 15 16").problem).toContain("at most 8");
  });
});
