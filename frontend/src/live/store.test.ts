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

function state(starts: number, rate_Hz: number, tick = 0): State {
  return {
    tick,
    link: { alive: true, silent_s: 0, starts },
    plant: { r_m: 0.0075, r_j: 0.075 },
    limits: { F_max: 50 },
    timing: { rate_Hz },
  } as State;
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

  it("takes a state for current until the connection ends, and again with the next state", () => {
    const store = new LiveStore(0);
    const { link } = store.snapshot();
    expect(store.snapshot().isStateCurrent).toBe(false);
    store.setLink({ ...link, phase: "open" });
    store.setState(state(1, 1000));
    expect(store.snapshot().isStateCurrent).toBe(true);
    store.setLink({ ...link, phase: "open", pinged_ms: 5 });
    expect(store.snapshot().isStateCurrent).toBe(true);
    store.setLink({ ...link, phase: "waiting" });
    store.setLink({ ...link, phase: "open" });
    expect(store.snapshot().isStateCurrent).toBe(false);
    store.setState(state(1, 1000));
    expect(store.snapshot().isStateCurrent).toBe(true);
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

  it("takes history in at once when it is whole, and never shows a part of it as present", () => {
    const store = new LiveStore(0);
    store.setLayout(LAYOUT);
    store.setState(state(1, 1000, 29_999));
    const shown: number[] = [];
    for (let tick = 0; tick < 30_000; tick += 4000) {
      store.addFrame(frame(tick, Math.min(4000, 30_000 - tick)), 5 + tick * 1e-6);
      shown.push(store.window.endTick);
    }
    expect(shown).toEqual([0, 0, 0, 0, 0, 0, 0, 30_000]);
    expect(store.window.startTick).toBe(0);
    expect(store.age(5.03)).toBeLessThan(0.01);
    store.addFrame(frame(30_000, 33), 5.063);
    expect(store.window.endTick).toBe(30_033);
    expect(store.age(5.063)).toBeLessThan(0.01);
    expect(store.age(6.063)).toBeCloseTo(1, 2);
  });

  it("shows samples of before as old until it is connected again and history is whole", () => {
    const store = new LiveStore(0);
    store.setLayout(LAYOUT);
    store.setState(state(1, 1000, 99));
    store.addFrame(frame(0, 100), 0.1);
    store.setLayout(LAYOUT);
    store.setState(state(1, 1000, 60_000));
    store.addFrame(frame(30_000, 4000), 60);
    expect(store.window.endTick).toBe(100);
    expect(store.age(60.1)).toBeCloseTo(60, 3);
    store.addFrame(frame(34_000, 26_100), 60.2);
    expect(store.window.endTick).toBe(60_100);
    expect(store.age(60.2)).toBe(0);
  });

  it("does not wait for ever for the end of history", () => {
    const store = new LiveStore(0);
    store.setLayout(LAYOUT);
    store.setState(state(1, 1000, 90_000));
    store.addFrame(frame(0, 33), 1);
    store.addFrame(frame(33, 33), 2.1);
    expect(store.window.endTick).toBe(66);
  });
});
