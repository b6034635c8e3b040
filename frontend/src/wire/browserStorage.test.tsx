import { expect, test, vi } from "vitest";
import { acceptsCookies, readStored, storeText } from "./browserStorage";

test("a text is kept and forgotten", () => {
  storeText("sessionStorage", "name", "text");
  expect(readStored("sessionStorage", "name")).toBe("text");
  storeText("sessionStorage", "name", null);
  expect(readStored("sessionStorage", "name")).toBeNull();
});

test.each(["localStorage", "sessionStorage"] as const)("a browser that refuses %s keeps nothing", (kind) => {
  vi.spyOn(globalThis, kind, "get").mockImplementation(() => {
    throw new DOMException("Access is denied for this document.", "SecurityError");
  });
  storeText(kind, "name", "text");
  storeText(kind, "name", null);
  expect(readStored(kind, "name")).toBeNull();
});

test("a cookie that is tried is not left behind", () => {
  expect(acceptsCookies()).toBe(true);
  expect(document.cookie).toBe("");
});

test("a browser that takes a cookie and keeps none keeps no cookies, nor does one that refuses to be asked", () => {
  const set = vi.spyOn(document, "cookie", "set").mockImplementation(() => undefined);
  expect(acceptsCookies()).toBe(false);
  set.mockImplementation(() => {
    throw new DOMException("The document is sandboxed.", "SecurityError");
  });
  expect(acceptsCookies()).toBe(false);
});
