import { expect, test } from "vitest";
import { RequestError } from "../../wire/client";
import { wayOf } from "./system";

test("what the service finds is said", async () => {
  expect(await wayOf(Promise.resolve({ problems: [] }))).toEqual({ problems: [], isAnswered: true });
  const found = await wayOf(Promise.resolve({ problems: [{ message: "wrong path" }] }));
  expect(found).toEqual({ problems: ["wrong path"], isAnswered: true });
});

test("a refusal says itself what is wrong", async () => {
  const refused = new RequestError("other origin", 403, { code: "foreign_origin", message: "other origin" });
  expect(await wayOf(Promise.reject(refused))).toEqual({ problems: ["other origin"], isAnswered: false });
});

test.each([404, 405, 502])("an answer %d of something else is one of a proxy", async (status) => {
  const { problems, isAnswered } = await wayOf(Promise.reject(new RequestError("?", status)));
  expect([problems.length, isAnswered]).toEqual([1, false]);
  expect(problems[0]).toContain(`${status}`);
  expect(problems[0]).not.toContain("cookies");
});

test("a proxy that refuses a large head is told with the cookies", async () => {
  const { problems } = await wayOf(Promise.reject(new RequestError("?", 400)));
  expect(problems[0]).toContain("cookies");
});

test("a service that cannot be reached says nothing of the way", async () => {
  const nobody = await wayOf(Promise.reject(new RequestError("no answer", 0)));
  expect(nobody).toEqual({ problems: [], isAnswered: false });
});
