import { describe, expect, it } from "vitest";
import { answered, RequestError, resultIn } from "./client";

describe("client", () => {
  const refusal = {
    error: {
      code: "out_of_range",
      message: "q_ref = 2.1 rad is above 1.571 rad",
      quantity: "q_ref",
      unit: "rad",
    },
  };

  async function failure(promise: Promise<unknown>): Promise<RequestError> {
    const error = await promise.then(
      () => null,
      (reason: unknown) => reason,
    );
    expect(error).toBeInstanceOf(RequestError);
    return error as RequestError;
  }

  describe("answered", () => {
    it("returns the data of a success", async () => {
      const answer = Promise.resolve({ data: { q_ref: 1 }, response: new Response(null, { status: 200 }) });
      expect(await answered(answer)).toEqual({ q_ref: 1 });
    });

    it("throws the service's own sentence", async () => {
      const answer = Promise.resolve({ error: refusal, response: new Response(null, { status: 422 }) });
      const error = await failure(answered(answer));
      expect(error.message).toBe("q_ref = 2.1 rad is above 1.571 rad");
      expect(error.status).toBe(422);
      expect(error.problem?.quantity).toBe("q_ref");
    });

    it("says so when nothing answers, or something that is no refusal", async () => {
      expect((await failure(answered(Promise.reject(new TypeError("fetch failed"))))).status).toBe(0);
      const odd = Promise.resolve({ error: "<html>", response: new Response(null, { status: 502 }) });
      expect((await failure(answered(odd))).message).toContain("502");
    });
  });
});

describe("lines", () => {
  /** An answer that comes in these pieces. */
  function body(...pieces: readonly string[]): ReadableStream<Uint8Array> {
    const encoder = new TextEncoder();
    return new ReadableStream({
      start(controller) {
        for (const piece of pieces) controller.enqueue(encoder.encode(piece));
        controller.close();
      },
    });
  }

  describe("resultIn", () => {
    it("tells how far it is and returns the result, wherever the pieces are cut", async () => {
      const text = '{"share":0.5,"result":null}\n{"share":1,"result":{"unit":"N·m/rad"}}\n';
      for (let cut = 1; cut < text.length; cut++) {
        const shares: number[] = [];
        const found = await resultIn(body(text.slice(0, cut), text.slice(cut)), (share) =>
          shares.push(share),
        );
        expect(found).toEqual({ unit: "N·m/rad" });
        expect(shares).toEqual([0.5, 1]);
      }
    });

    it("does not take an answer that broke off for a result", async () => {
      await expect(resultIn(body('{"share":0.5}\n{"share":1,"res'), () => undefined)).rejects.toThrow(
        "before the result",
      );
    });
  });
});
