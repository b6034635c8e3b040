/** How long a test waits for what it asks for: as long as a busy machine may need. What never comes still fails. */

if (typeof document !== "undefined") {
  // Only where there is a page: to load it takes longer than most of what only computes.
  const { configure } = await import("@testing-library/dom");
  configure({ asyncUtilTimeout: 20_000 });
  // The chart library asks for it when it loads, and jsdom has none.
  window.matchMedia ??= () => ({ matches: false, addEventListener() {}, removeEventListener() {} }) as never;
}

export {};
