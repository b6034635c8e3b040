import { act, renderHook } from "@testing-library/react";
import { describe, expect, it, vi } from "vitest";
import { type DraftEvent, FOLLOWING, nextDraft, shown, useSentValue } from "./drafts";

describe("useSentValue", () => {
  interface Sending {
    readonly value: number;
    accept(): void;
    refuse(reason: string): void;
  }

  /** A service that answers only when it is told to. */
  function slowService() {
    const sent: Sending[] = [];
    const send = vi.fn(
      (value: number) =>
        new Promise<void>((resolve, reject) => {
          sent.push({ value, accept: resolve, refuse: (reason) => reject(new Error(reason)) });
        }),
    );
    return { sent, send };
  }

  function start(inForce: number) {
    const service = slowService();
    const hook = renderHook(({ now }) => useSentValue(now, service.send), { initialProps: { now: inForce } });
    return { ...service, ...hook };
  }

  it("sends on release only, and shows what came into force", async () => {
    const { sent, send, result, rerender } = start(0.5);
    act(() => result.current.edit(0.6));
    expect(send).not.toHaveBeenCalled();
    act(() => result.current.commit(0.6));
    expect(result.current).toMatchObject({ value: 0.6, pending: true });
    await act(async () => sent[0]?.accept());
    rerender({ now: 0.59 });
    expect(result.current).toMatchObject({ value: 0.59, pending: false, refusal: null });
  });

  it("falls back to what is in force when refused, and says why", async () => {
    const { sent, result } = start(0.5);
    act(() => result.current.commit(9));
    await act(async () => sent[0]?.refuse("too slow"));
    expect(result.current.value).toBe(0.5);
    expect(result.current.refusal?.message).toBe("too slow");
  });

  it("has one value under way at a time and sends only the newest of those that waited", async () => {
    const { sent, send, result } = start(0.5);
    for (const value of [0.6, 0.7, 0.8, 0.9]) act(() => result.current.commit(value));
    expect(send).toHaveBeenCalledTimes(1);
    await act(async () => sent[0]?.accept());
    expect(send.mock.calls.map(([value]) => value)).toEqual([0.6, 0.9]);
    expect(result.current).toMatchObject({ value: 0.9, pending: true });
  });

  it("does not let a report overwrite what is being edited", () => {
    const { result, rerender } = start(0.5);
    act(() => result.current.edit(0.8));
    rerender({ now: 0.4 });
    expect(result.current.value).toBe(0.8);
  });
});

describe("draft", () => {
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
});
