import { describe, expect, it } from "vitest";
import { type DraftEvent, FOLLOWING, nextDraft, shown } from "./drafts";

const played = (...events: DraftEvent[]) => events.reduce(nextDraft, FOLLOWING);

describe("draft", () => {
  it("is not overwritten by reports while it is edited", () => {
    const draft = played({ kind: "edit", value: 12 }, { kind: "read-back" });
    expect(shown(draft, 5)).toBe(12);
  });

  it("stays in sight once sent, until the service reports what is in force", () => {
    const sent = played({ kind: "edit", value: 12 }, { kind: "send", value: 12 });
    expect(shown(sent, 5)).toBe(12);
    expect(shown(nextDraft(sent, { kind: "read-back" }), 11.9)).toBe(11.9);
  });

  it("falls back to what is in force when refused", () => {
    expect(shown(played({ kind: "send", value: 99 }, { kind: "drop" }), 5)).toBe(5);
  });
});
