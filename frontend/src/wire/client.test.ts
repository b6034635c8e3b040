import { describe, expect, it } from "vitest";
import { answered, RequestError } from "./client";

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
