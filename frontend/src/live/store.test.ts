import { describe, expect, it } from "vitest";
import type { Layout, State } from "../wire/types";
import { LiveStore } from "./store";

const LAYOUT: Layout = {
  type: "layout",
  fields: [{ name: "q", symbol: "q", unit: "rad", meaning: "joint position" }],
  period_s: 0.001,
  modes: ["off"],
  faults: ["none"],
  limits: {},
};

function state(starts: number, rate_Hz: number): State {
  return { link: { alive: true, silent_s: 0, starts }, limits: { F_max: 50 }, timing: { rate_Hz } } as State;
}

function frame(firstTick: number, count: number, missed = 0) {
  return { firstTick, count, missed, columns: [new Float32Array(count).fill(1)] };
}

describe("LiveStore", () => {
  it("keeps the identity of what did not change", () => {
    const store = new LiveStore(0);
    store.setState(state(1, 1000));
    const limits = store.snapshot().state?.limits;
    store.setState(state(1, 999));
    expect(store.snapshot().state?.limits).toBe(limits);
    expect(store.snapshot().state?.timing.rate_Hz).toBe(999);
  });

  it("keeps samples over a reconnection, and drops them when the loop was started anew", () => {
    const store = new LiveStore(0);
    store.setLayout(LAYOUT);
    store.setState(state(1, 1000));
    store.addFrame(frame(0, 100), 0.1);
    store.setLayout(LAYOUT);
    expect(store.window.endTick).toBe(100);
    store.setState(state(2, 1000));
    expect(store.window.length).toBe(0);
  });

  it("counts what it missed and tells its listeners", () => {
    const store = new LiveStore(0);
    let told = 0;
    const leave = store.subscribe(() => {
      told += 1;
    });
    store.setLayout(LAYOUT);
    store.addFrame(frame(0, 10), 0.1);
    store.addFrame(frame(30, 10, 20), 0.2);
    expect(store.snapshot().missed).toBe(20);
    expect(told).toBe(2);
    leave();
    store.addMark({ type: "event", tick: 5, kind: "note", text: "x" });
    expect(told).toBe(2);
    expect(store.snapshot().marks).toHaveLength(1);
  });
});
