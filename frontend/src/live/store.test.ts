import { describe, expect, it } from "vitest";
import type { Layout, State } from "../wire/types";
import { LiveStore, SampleClock } from "./store";

describe("SampleClock", () => {
  it("runs evenly although frames arrive early and late", () => {
    const clock = new SampleClock();
    const jitter = [0, 0.012, -0.008, 0.02, 0.003];
    for (let frame = 0; frame < 300; frame++) {
      clock.observe(frame * 0.033, 100 + frame * 0.033 + (jitter[frame % 5] as number));
    }
    const last = 299 * 0.033;
    const shown = clock.at(100 + last);
    expect(Math.abs(shown - last)).toBeLessThan(0.02);
    expect(clock.at(100 + last + 0.016) - shown).toBeCloseTo(0.016, 6);
  });

  it("stops shortly after the last sample", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    expect(clock.at(60)).toBeCloseTo(10.05, 6);
  });

  it("jumps after a pause instead of catching up", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    clock.observe(10.1, 5);
    expect(clock.at(5)).toBeCloseTo(10.1, 6);
  });

  it("returns the age of the newest sample while frames are late and while none arrive", () => {
    const clock = new SampleClock();
    expect(clock.age(0)).toBeNull();
    for (let frame = 0; frame <= 300; frame++) clock.observe(frame * 0.033, 100 + frame * 0.033);
    const now_s = 109.9;
    expect(clock.age(now_s)).toBeCloseTo(0, 3);
    expect(clock.age(now_s + 2)).toBeCloseTo(2, 3);
    // The page was suspended for 5 s: the waiting frames arrive at once, the newest one last.
    const ages = Array.from({ length: 150 }, (_, frame) => {
      clock.observe(9.9 + (frame + 1) * 0.0333, now_s + 5 + frame * 1e-4);
      return clock.age(now_s + 5 + frame * 1e-4) as number;
    });
    expect(ages[0]).toBeGreaterThan(4.5);
    expect(ages[100]).toBeGreaterThan(0.3); // grey on the page
    expect(ages.at(-1)).toBeLessThan(0.1);
  });

  it("adapts gradually after the control loop has paused", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    let until_s = 0;
    for (let frame = 0; (clock.age(3600 + frame * 0.033) ?? 0) > 0.1 && frame < 3000; frame++) {
      until_s = frame * 0.033;
      clock.observe(10 + until_s, 3600 + until_s);
    }
    expect(until_s).toBeLessThan(25);
  });
});

describe("store", () => {
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
    it("preserves the identity of unchanged parts", () => {
      const store = new LiveStore(0);
      store.setState(state(1, 1000));
      const limits = store.snapshot().state?.limits;
      store.setState(state(1, 999));
      expect(store.snapshot().state?.limits).toBe(limits);
      expect(store.snapshot().state?.timing.rate_Hz).toBe(999);
    });

    it("retains samples over a reconnection, and drops them when the loop restarts", () => {
      const store = new LiveStore(0);
      store.setLayout(LAYOUT);
      store.setState(state(1, 1000));
      store.addFrame(frame(0, 100), 0.1);
      store.setLayout(LAYOUT);
      expect(store.window.endTick).toBe(100);
      store.setState(state(2, 1000));
      expect(store.window.length).toBe(0);
    });

    it("marks the state as current until the connection ends, and again with the next state", () => {
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

    it("counts missed samples and notifies its listeners", () => {
      const store = new LiveStore(0);
      let notified = 0;
      const unsubscribe = store.subscribe(() => {
        notified += 1;
      });
      store.setLayout(LAYOUT);
      store.addFrame(frame(0, 10), 0.1);
      store.addFrame(frame(30, 10, 20), 0.2);
      expect(store.snapshot().missed).toBe(20);
      expect(notified).toBe(2);
      unsubscribe();
      store.addMark({ type: "event", tick: 5, kind: "note", text: "x" });
      expect(notified).toBe(2);
      expect(store.snapshot().marks).toHaveLength(1);
    });

    it("adds the history when it is complete, and never shows part of it as current", () => {
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

    it("shows earlier samples as old until it has reconnected and the history is complete", () => {
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

    it("does not wait without limit for the end of the history", () => {
      const store = new LiveStore(0);
      store.setLayout(LAYOUT);
      store.setState(state(1, 1000, 90_000));
      store.addFrame(frame(0, 33), 1);
      store.addFrame(frame(33, 33), 2.1);
      expect(store.window.endTick).toBe(66);
    });
  });
});
