import { mergeConfig } from "vite";
import { defineConfig } from "vitest/config";
import build from "./vite.config";

export default mergeConfig(
  build,
  defineConfig({
    test: {
      restoreMocks: true,
      setupFiles: ["src/testSetup.ts"],
      testTimeout: 60_000,
      css: { include: /\.css\?raw$/ }, // what a test reads; what pages import stays empty
      projects: [
        { extends: true, test: { name: "paged", include: ["src/**/*.test.tsx"], environment: "jsdom" } },
        // What only computes needs no page and leaves nothing behind: its files share what they load.
        {
          extends: true,
          test: { name: "computing", include: ["src/**/*.test.ts"], isolate: false, unstubGlobals: true },
        },
      ],
    },
  }),
);
