import { describe, expect, it, vi } from "vitest";
import type { Flight, Trigger } from "../../wire/types";
import { describeTrigger, flightOf } from "./recordings";

// the REST client captures fetch when it is created
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

describe("flightOf", () => {
  const FLIGHT: Flight = {
    id: 5,
    at: "2026-03-04T10:20:30Z",
    kind: "trip",
    who: "",
    fault: "tension",
    text: "",
    run: null,
    tick: 10_000,
    before_s: 10,
    after_s: 5,
  };

  it("returns the newest record if the fault's tick is within the seconds after its trip", () => {
    const flights = [FLIGHT, { ...FLIGHT, id: 4, tick: 2_000 }];
    expect(flightOf(flights, { tick: 10_000 })?.id).toBe(5);
    expect(flightOf(flights, { tick: 14_999 })?.id).toBe(5);
    expect(flightOf(flights, { tick: 15_001 })).toBeUndefined();
    expect(flightOf(flights, { tick: 9_999 })).toBeUndefined();
    expect(flightOf(flights, { tick: 2_000 })).toBeUndefined();
    expect(flightOf(flights, null)).toBeUndefined();
    expect(flightOf([], { tick: 1 })).toBeUndefined();
    const trigger: Flight = { ...FLIGHT, id: 6, kind: "trigger", tick: 10_500 };
    expect(flightOf([trigger, ...flights], { tick: 11_000 })?.id).toBe(5);
    expect(flightOf([trigger], { tick: 11_000 })).toBeUndefined();
  });
});

describe("trigger", () => {
  const ARMED: Trigger = {
    signal: "F_A",
    condition: "rising",
    level: 20,
    upper: null,
    before_s: 1,
    after_s: 2,
    captures: 3,
    unit: "N",
    says: "F_A rising through 20 N",
    who: "Ana",
    at: "2026-01-01T00:00:00Z",
    phase: "armed",
    captured: 1,
    left_s: 0,
    ended: "",
  };

  it("describes the condition, the progress of a recording, and why the trigger is not armed", () => {
    expect(describeTrigger(null)).toBe("Not armed");
    expect(describeTrigger(ARMED)).toBe("Armed: F_A rising through 20 N; 1 of 3 captured");
    expect(describeTrigger({ ...ARMED, phase: "capturing", left_s: 1.25 })).toMatch(
      /^Capturing: .*; 1\.[23] s left$/,
    );
    expect(
      describeTrigger({ ...ARMED, phase: "ended", captured: 3, ended: "all captures are complete" }),
    ).toBe("Not armed: all captures are complete; 3 of 3 captured");
  });
});
