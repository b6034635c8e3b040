import { describe, expect, it, vi } from "vitest";
import { isStopKey, sendStop } from "./stop";

const PROOF = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 1, paused_recording: false };

describe("sendStop", () => {
  it("returns the proof", async () => {
    expect(await sendStop(async () => PROOF)).toEqual({ kind: "confirmed", proof: PROOF });
  });

  it("retries when no response arrives", async () => {
    const post = vi.fn().mockRejectedValueOnce(new Error("no answer")).mockResolvedValue(PROOF);
    expect(await sendStop(post)).toEqual({ kind: "confirmed", proof: PROOF });
    expect(post).toHaveBeenCalledTimes(2);
  });

  it("returns that the stop is not confirmed, with the reason", async () => {
    const post = vi.fn().mockRejectedValue(new Error("The service cannot be reached."));
    expect(await sendStop(post)).toEqual({ kind: "unconfirmed", reason: "The service cannot be reached." });
    expect(post).toHaveBeenCalledTimes(3);
  });
});

describe("isStopKey", () => {
  const key = { ctrlKey: false, metaKey: false, shiftKey: false, code: "KeyE" };

  it("is Ctrl or Cmd with Shift and E", () => {
    expect(isStopKey({ ...key, ctrlKey: true, shiftKey: true })).toBe(true);
    expect(isStopKey({ ...key, metaKey: true, shiftKey: true })).toBe(true);
  });

  it("is no other combination", () => {
    expect(isStopKey({ ...key, ctrlKey: true })).toBe(false);
    expect(isStopKey({ ...key, shiftKey: true })).toBe(false);
    expect(isStopKey({ ...key, ctrlKey: true, shiftKey: true, code: "KeyR" })).toBe(false);
  });
});
