import { describe, expect, it } from "vitest";
import { actuatorPose } from "./ActuatorDrawing";

const REST = { q: 0, q_ref: 0, S: 10, theta_A: 4, theta_B: 4, F_A: 20, F_B: 20 };

describe("actuatorPose", () => {
  it("is symmetric at rest", () => {
    const pose = actuatorPose(REST, 1);
    expect(pose.A.springLength).toBe(pose.B.springLength);
    expect(pose.link_deg).toBeCloseTo(0, 12);
  });

  it("turns the link towards the tendon that pulls harder and compresses its spring more", () => {
    const turned = actuatorPose({ ...REST, q: 0.2, theta_A: 7, theta_B: 1, F_A: 30, F_B: 15 }, 1);
    expect(turned.link_deg).toBeLessThan(0);
    const loaded = actuatorPose({ ...REST, theta_A: 7, theta_B: 1, F_A: 30, F_B: 2 }, 1);
    expect(loaded.A.springLength).toBeLessThan(loaded.B.springLength);
    expect(loaded.A.tendon).toBeGreaterThan(loaded.B.tendon);
  });

  it("shows a slack tendon, and a finite pose before the first sample", () => {
    expect(actuatorPose({ ...REST, F_B: 0.2 }, 1).B.slack).toBe(true);
    const none = actuatorPose(
      Object.fromEntries(Object.keys(REST).map((name) => [name, Number.NaN])) as typeof REST,
      1,
    );
    expect(none.ghost_deg).toBeNull();
    expect([none.link_deg, none.A.springLength, none.B.tendon].every(Number.isFinite)).toBe(true);
    expect([none.A.slack, none.B.slack, none.slack]).toEqual([false, false, false]);
    expect(none.fan_deg).toBeNull();
  });

  it("has no compliance fan while a tendon is slack or the stiffness is unknown", () => {
    for (const loose of [{ F_A: 0.1 }, { F_B: 0.1 }]) {
      const pose = actuatorPose({ ...REST, ...loose, S: -8.7 }, 1);
      expect([pose.slack, pose.fan_deg]).toEqual([true, null]);
    }
    expect(actuatorPose({ ...REST, S: Number.NaN }, 1).fan_deg).toBeNull();
  });

  it("opens the fan wider for a softer joint", () => {
    const soft = actuatorPose({ ...REST, S: 8 }, 1).fan_deg;
    expect(soft).toBeCloseTo((2 / 8) * (180 / Math.PI), 9);
    expect(soft).toBeGreaterThan(actuatorPose({ ...REST, S: 14 }, 1).fan_deg ?? Number.NaN);
  });
});
