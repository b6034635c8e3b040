import "@mantine/core/styles.css";
import "uplot/dist/uPlot.min.css";
import "./theme/base.css";
import { MantineProvider } from "@mantine/core";
import { MutationCache, QueryCache, QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { Router } from "wouter";
import { useHashLocation } from "wouter/use-hash-location";
import { App } from "./App";
import { ErrorBoundary } from "./components/ErrorBoundary";
import { sessionQuery } from "./service/api/session";
import { theme } from "./theme/theme";
import { RequestError } from "./wire/client";

const queries: QueryClient = new QueryClient({
  queryCache: new QueryCache({ onError: reloadSession }),
  mutationCache: new MutationCache({ onError: reloadSession }),
  defaultOptions: {
    queries: { staleTime: 2000, refetchOnWindowFocus: false, retry: isRetryable },
    mutations: { retry: false },
  },
});

/** A 401 response means that the session has ended: reloads the session, so that the page shows the sign-in form. */
function reloadSession(error: Error): void {
  const session = queries.getQueryState(sessionQuery.queryKey);
  if (error instanceof RequestError && error.status === 401 && session?.status === "success") {
    void queries.invalidateQueries(sessionQuery);
  }
}

/** Retries only requests without an answer: the service would refuse a refused request again. */
function isRetryable(failures: number, error: Error): boolean {
  const refused = error instanceof RequestError && error.status >= 400 && error.status < 500;
  return !refused && failures < 3;
}

createRoot(document.getElementById("root") as HTMLElement).render(
  <StrictMode>
    <MantineProvider theme={theme} defaultColorScheme="auto">
      <QueryClientProvider client={queries}>
        <Router hook={useHashLocation}>
          <ErrorBoundary of="Sinew">
            <App />
          </ErrorBoundary>
        </Router>
      </QueryClientProvider>
    </MantineProvider>
  </StrictMode>,
);
