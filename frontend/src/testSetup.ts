/** Sets how long a test waits for an element, long enough for a busy machine, and stubs what jsdom lacks. */

if (typeof document !== "undefined") {
  // Only with a DOM: loading the library takes longer than most tests without one.
  const { configure } = await import("@testing-library/dom");
  configure({ asyncUtilTimeout: 20_000 });
  // uPlot calls it when it loads, and jsdom does not provide it.
  window.matchMedia ??= () => ({ matches: false, addEventListener() {}, removeEventListener() {} }) as never;
}

export {};
