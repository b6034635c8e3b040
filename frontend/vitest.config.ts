import { mergeConfig } from "vite";
import { defineConfig } from "vitest/config";
import build from "./vite.config";

export default mergeConfig(
  build,
  defineConfig({
    test: {
      include: ["src/**/*.test.{ts,tsx}"],
      restoreMocks: true,
      setupFiles: ["src/testSetup.ts"],
      testTimeout: 60_000,
    },
  }),
);
