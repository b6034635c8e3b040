import { describe, expect, it } from "vitest";
import { decodeFrame, parseMessage } from "./liveMessages";
import { encodeFrame } from "./liveMessages.fixture";

describe("parseMessage", () => {
  it("passes the kinds it knows on", () => {
    expect(parseMessage('{"type":"event","tick":3,"kind":"mode","text":"run"}')).toEqual({
      type: "event",
      tick: 3,
      kind: "mode",
      text: "run",
    });
  });

  it("ignores kinds of a newer service", () => {
    expect(parseMessage('{"type":"weather"}')).toBeNull();
  });

  it("refuses what is no message", () => {
    expect(() => parseMessage("[1]")).toThrow(SyntaxError);
    expect(() => parseMessage("null")).toThrow(SyntaxError);
    expect(() => parseMessage("{")).toThrow(SyntaxError);
  });
});

describe("decodeFrame", () => {
  it("reads header and columns", () => {
    const message = encodeFrame(5_000_000_000, 7, [
      [1.5, -2.25],
      [Number.NaN, 4],
    ]);
    const frame = decodeFrame(message, 2);
    expect(frame.firstTick).toBe(5_000_000_000);
    expect(frame.count).toBe(2);
    expect(frame.missed).toBe(7);
    expect(Array.from(frame.columns[0] as Float32Array)).toEqual([1.5, -2.25]);
    expect(Array.from(frame.columns[1] as Float32Array)).toEqual([Number.NaN, 4]);
  });

  it("copies nothing", () => {
    const message = encodeFrame(0, 0, [[1], [2]]);
    expect(decodeFrame(message, 2).columns[1]?.buffer).toBe(message);
  });

  it("accepts an empty frame that only reports missed samples", () => {
    expect(decodeFrame(encodeFrame(9, 4, [[], []]), 2)).toMatchObject({ count: 0, missed: 4 });
  });

  it("refuses a message cut short, and one for another layout", () => {
    const message = encodeFrame(0, 0, [
      [1, 2],
      [3, 4],
    ]);
    expect(() => decodeFrame(message.slice(0, 10), 2)).toThrow(/10 bytes/);
    expect(() => decodeFrame(message.slice(0, -4), 2)).toThrow(RangeError);
    expect(() => decodeFrame(message, 3)).toThrow(/2 × 3 values/);
  });
});
