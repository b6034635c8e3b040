/** Application frame: header, status line, navigation and one page. */

import { useMantineColorScheme } from "@mantine/core";
import { useDisclosure, useHotkeys } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { lazy, Suspense, useEffect, useState } from "react";
import { Redirect, Route, Switch, useLocation } from "wouter";
import styles from "./App.module.css";
import { AddressProblems, Problems } from "./components/AddressProblems";
import { ControlLoss } from "./components/ControlMenu";
import { ErrorBoundary } from "./components/ErrorBoundary";
import { Explanation } from "./components/Explanation";
import { Header } from "./components/Header";
import { NameQuestion } from "./components/NameQuestion";
import { Navigation, usePages } from "./components/Navigation";
import { Shortcuts } from "./components/Shortcuts";
import { StatusStrip } from "./components/StatusStrip";
import { SetupDrawer } from "./components/setup/SetupDrawer";
import { Tour } from "./components/setup/Tour";
import { LiveProvider } from "./live/react";
import { OperatePage } from "./pages/operate/OperatePage";
import { EXPERIMENTS, RUNS } from "./pages/runs/runAddress";
import { CookiesBlockedPage, SignInPage } from "./pages/SignInPage";
import { useLiveFormulas } from "./service/api/formulas";
import { AngleUnitContext, usePreferences } from "./service/api/preferences";
import { sessionQuery } from "./service/api/session";
import { useRefetchOnChanges } from "./service/api/useRefetchOnChanges";
import type { ControlForm } from "./service/control/handover";
import { useNotifications } from "./service/notifications/useNotifications";
import { acceptsCookies } from "./wire/browserStorage";
import { RequestError } from "./wire/client";

const IdentifyPage = lazy(() => import("./pages/identify/IdentifyPage"));
const BringUpPage = lazy(() => import("./pages/bringUp/BringUpPage"));
const BanksPage = lazy(() => import("./pages/banks/BanksPage"));
const ExperimentsPage = lazy(() => import("./pages/experiments/ExperimentsPage"));
const RunsPage = lazy(() => import("./pages/runs/RunsPage"));
const FlightPage = lazy(() => import("./pages/runs/FlightPage"));
const StudiesPage = lazy(() => import("./pages/studies/StudiesPage"));
const DocsPage = lazy(() => import("./pages/docs/DocsPage"));
const GlossaryPage = lazy(() => import("./pages/glossary/GlossaryPage"));
const DeveloperPage = lazy(() => import("./pages/system/DeveloperPage"));
const LogPage = lazy(() => import("./pages/log/LogPage"));
const SystemPage = lazy(() => import("./pages/system/SystemPage"));

/** Route of a page and of its items by number; other paths do not match. */
const numbered = (page: string) => new RegExp(`^/${page}(?:/(?<id>\\d+))?$`);
const IDENTIFY = numbered("identify");
const BANKS = numbered("banks");
const STUDIES = numbered("studies");
const DOCS = /^\/docs(?:\/(?<rest>.+))?$/;
const FLIGHT = /^\/flights\/(?<id>[1-9]\d*)$/;

export function App() {
  const [isUsable] = useState(acceptsCookies);
  return isUsable ? <Dashboard /> : <CookiesBlockedPage />;
}

function Dashboard() {
  const session = useQuery(sessionQuery);
  const signedOut = session.error instanceof RequestError && session.error.status === 401;
  return (
    <>
      {signedOut ? (
        <>
          <Problems />
          <SignInPage />
        </>
      ) : (
        <LiveProvider>
          <Shell />
        </LiveProvider>
      )}
    </>
  );
}

/** Applies the colour scheme from the person's preferences, which the service stores. */
function useScheme(): void {
  const { setColorScheme } = useMantineColorScheme();
  const { preferences, known } = usePreferences();
  useEffect(() => {
    if (known) setColorScheme(preferences.scheme);
  }, [known, preferences.scheme, setColorScheme]);
}

function Shell() {
  const [shortcuts, { open, close, toggle }] = useDisclosure(false);
  const [settingUp, setup] = useDisclosure(false);
  const [naming, name] = useDisclosure(false);
  const [form, setForm] = useState<ControlForm | null>(null);
  const [address, go] = useLocation();
  const pages = usePages();
  useRefetchOnChanges();
  useScheme();
  useNotifications();
  useLiveFormulas();
  useHotkeys([
    ["?", toggle],
    ["c", setup.toggle],
    ["g", () => go("/glossary")],
    ["d", () => go("/docs")],
    ...pages.map(({ path, key }): [string, () => void] => [key, () => go(path)]),
  ]);
  const { angles } = usePreferences().preferences;
  return (
    <AngleUnitContext value={angles}>
      <div className={styles.shell}>
        <ErrorBoundary of="Header">
          <Header onShortcuts={open} onName={name.open} onForm={setForm} />
        </ErrorBoundary>
        <ErrorBoundary of="Status">
          <StatusStrip form={form} onForm={setForm} />
        </ErrorBoundary>
        <ErrorBoundary of="Notices">
          <AddressProblems />
          <ControlLoss />
          <NameQuestion wanted={naming} onDone={name.close} />
          <Tour />
        </ErrorBoundary>
        <div className={styles.body}>
          <ErrorBoundary of="Navigation">
            <Navigation onSetup={setup.open} onShortcuts={open} />
          </ErrorBoundary>
          <main className={styles.page}>
            <ErrorBoundary of="Page" at={address}>
              <Suspense>
                <Switch>
                  <Route path="/operate" component={OperatePage} />
                  <Route path="/bring-up" component={BringUpPage} />
                  <Route path={IDENTIFY} component={IdentifyPage} />
                  <Route path={BANKS} component={BanksPage} />
                  <Route path={EXPERIMENTS} component={ExperimentsPage} />
                  <Route path={STUDIES} component={StudiesPage} />
                  <Route path={RUNS} component={RunsPage} />
                  <Route path={FLIGHT} component={FlightPage} />
                  <Route path="/log" component={LogPage} />
                  <Route path={DOCS} component={DocsPage} />
                  <Route path="/glossary" component={GlossaryPage} />
                  <Route path="/system/developer" component={DeveloperPage} />
                  <Route path="/system" component={SystemPage} />
                  <Route>
                    <Redirect to="/operate" replace />
                  </Route>
                </Switch>
              </Suspense>
            </ErrorBoundary>
          </main>
        </div>
        <ErrorBoundary of="Help">
          <Shortcuts opened={shortcuts} onClose={close} />
          <Explanation />
        </ErrorBoundary>
        <ErrorBoundary of="Setup">
          <SetupDrawer opened={settingUp} onClose={setup.close} />
        </ErrorBoundary>
      </div>
    </AngleUnitContext>
  );
}
