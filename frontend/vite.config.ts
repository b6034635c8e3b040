import react from "@vitejs/plugin-react";
import { defineConfig, type Plugin } from "vite";

const SERVICE = "http://127.0.0.1:8000";

/** STOP is a file of its own, which the page loads apart from the bundle: without its bundle it still stops. */
const STOP = "src/stop/stop.ts";

const stopInDevelopment: Plugin = {
  name: "stop-in-development",
  configureServer(server) {
    server.middlewares.use((request, _response, next) => {
      const asked = request as { url?: string };
      if (asked.url === "/stop.js") asked.url = `/${STOP}`;
      next();
    });
  },
};

export default defineConfig({
  base: "./",
  plugins: [react(), stopInDevelopment],
  build: {
    outDir: "../backend/static",
    emptyOutDir: true,
    chunkSizeWarningLimit: 1600,
    rolldownOptions: {
      input: { index: "index.html", docs: "docs.html", stop: STOP },
      output: {
        entryFileNames: ({ name }) => (name === "stop" ? "stop.js" : "assets/[name]-[hash].js"),
      },
    },
  },
  server: {
    proxy: {
      "/api": { target: SERVICE, ws: true },
      "/scene": { target: SERVICE, ws: true },
    },
  },
});
