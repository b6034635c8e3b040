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
  queryCache: new QueryCache({ onError: askWhoIsSignedIn }),
  mutationCache: new MutationCache({ onError: askWhoIsSignedIn }),
  defaultOptions: {
    queries: { staleTime: 2000, refetchOnWindowFocus: false, retry: mayAnswerLater },
    mutations: { retry: false },
  },
});

/** Whatever the service refuses for want of a session, the session has ended: the page says so, and what to do. */
function askWhoIsSignedIn(error: Error): void {
  const asked = queries.getQueryState(sessionQuery.queryKey);
  if (error instanceof RequestError && error.status === 401 && asked?.status === "success") {
    void queries.invalidateQueries(sessionQuery);
  }
}

/** What the service refuses it refuses again: only what it could not answer is asked for once more. */
function mayAnswerLater(failures: number, error: Error): boolean {
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
