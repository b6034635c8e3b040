import { describe, expect, it } from "vitest";
import { parseMessage } from "./message";

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
