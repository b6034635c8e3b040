import { expect, test, vi } from "vitest";
import { keepsCookies, keepText, readKept } from "./browserStorage";

test("a text is kept and forgotten", () => {
  keepText("sessionStorage", "name", "text");
  expect(readKept("sessionStorage", "name")).toBe("text");
  keepText("sessionStorage", "name", null);
  expect(readKept("sessionStorage", "name")).toBeNull();
});

test.each(["localStorage", "sessionStorage"] as const)("a browser that refuses %s keeps nothing", (kind) => {
  vi.spyOn(globalThis, kind, "get").mockImplementation(() => {
    throw new DOMException("Access is denied for this document.", "SecurityError");
  });
  keepText(kind, "name", "text");
  keepText(kind, "name", null);
  expect(readKept(kind, "name")).toBeNull();
});

test("a cookie that is tried is not left behind", () => {
  expect(keepsCookies()).toBe(true);
  expect(document.cookie).toBe("");
});

test("a browser that takes a cookie and keeps none keeps no cookies, nor does one that refuses to be asked", () => {
  const set = vi.spyOn(document, "cookie", "set").mockImplementation(() => undefined);
  expect(keepsCookies()).toBe(false);
  set.mockImplementation(() => {
    throw new DOMException("The document is sandboxed.", "SecurityError");
  });
  expect(keepsCookies()).toBe(false);
});
