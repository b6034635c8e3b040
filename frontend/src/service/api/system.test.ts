import { expect, test } from "vitest";
import { RequestError } from "../../wire/client";
import { addressCheckOf } from "./system";

test("what the service finds is said", async () => {
  expect(await addressCheckOf(Promise.resolve({ problems: [] }))).toEqual({ problems: [], isAnswered: true });
  const found = await addressCheckOf(Promise.resolve({ problems: [{ message: "wrong path" }] }));
  expect(found).toEqual({ problems: ["wrong path"], isAnswered: true });
});

test("a refusal says itself what is wrong", async () => {
  const refused = new RequestError("other origin", 403, { code: "foreign_origin", message: "other origin" });
  expect(await addressCheckOf(Promise.reject(refused))).toEqual({
    problems: ["other origin"],
    isAnswered: false,
  });
});

test.each([404, 405, 502])("an answer %d of something else is one of a proxy", async (status) => {
  const { problems, isAnswered } = await addressCheckOf(Promise.reject(new RequestError("?", status)));
  expect([problems.length, isAnswered]).toEqual([1, false]);
  expect(problems[0]).toContain(`${status}`);
  expect(problems[0]).not.toContain("cookies");
});

test("a proxy that refuses a large head is told with the cookies", async () => {
  const { problems } = await addressCheckOf(Promise.reject(new RequestError("?", 400)));
  expect(problems[0]).toContain("cookies");
});

test("a service that cannot be reached says nothing of the way", async () => {
  const nobody = await addressCheckOf(Promise.reject(new RequestError("no answer", 0)));
  expect(nobody).toEqual({ problems: [], isAnswered: false });
});
