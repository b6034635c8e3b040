/** First steps for somebody new, in a line of their own so that nothing is covered; what is meant is outlined. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useLocation } from "wouter";
import { usePreferences } from "../../service/api/preferences";
import { sessionQuery } from "../../service/api/session";
import styles from "./Tour.module.css";

const STEPS = [
  {
    target: "STOP",
    text: "STOP cuts the motors within two ticks, from every page. Ctrl/Cmd+Shift+E does the same, in text fields too.",
  },
  {
    target: "Change mode",
    text: "Begin with Pretension: both tendons are wound up to 10 N. Run then closes the loops and records.",
  },
  {
    target: "Charts",
    text: "The wheel with Ctrl zooms time (hold V for values), dragging pans, a double click resets, Live returns to now. The arrows beside a title show that panel alone; Esc shows all.",
  },
  {
    target: "Reachable map",
    text: "A click in the map aims at a position and a stiffness, Send target commands both; the service refuses with a reason what the joint cannot reach.",
  },
  {
    target: "Tuning",
    text: "In lambda motion λ sets how fast each loop is; in time-optimal motion a voltage limit does, and λ sets robustness. The preview follows while you drag; staged values can be tried for some seconds.",
  },
  {
    target: "Set-up",
    text: "The set-up list leads from pretension over identification and bank to a report, and shows what is out of date.",
  },
] as const;

export function Tour() {
  const { preferences, known, change } = usePreferences();
  const [at, setAt] = useState(0);
  const [, go] = useLocation();
  const name = useQuery(sessionQuery).data?.name;
  // whoever ends the tour and takes a name afterwards has new preferences, and has seen the tour
  const [endedAs, setEndedAs] = useState<string>();
  const isRenamed = endedAs !== undefined && name !== undefined && name !== endedAs;
  const shown = known && !preferences.toured && !isRenamed;
  const step = STEPS[at] ?? STEPS[0];

  useEffect(() => {
    if (!shown) return;
    const target = document.querySelector<HTMLElement>(`[aria-label="${step.target}"]`);
    if (target === null) return;
    target.dataset.toured = "true";
    return () => {
      delete target.dataset.toured;
    };
  }, [shown, step]);

  useEffect(() => {
    if (!isRenamed || !known || preferences.toured) return;
    change({ toured: true });
    setEndedAs(name);
  }, [isRenamed, known, preferences.toured, name, change]);

  if (!shown) return null;
  const last = at === STEPS.length - 1;
  const end = () => {
    setAt(0);
    setEndedAs(name);
    change({ toured: true });
  };
  return (
    <section className={styles.tour} aria-label="Tour">
      <span className={styles.count}>
        {at + 1} of {STEPS.length}
      </span>
      <output className={styles.text}>{step.text}</output>
      <Button variant="default" size="compact-sm" disabled={at === 0} onClick={() => setAt(at - 1)}>
        Back
      </Button>
      <Button
        size="compact-sm"
        onClick={() => {
          if (last) end();
          else {
            go("/operate");
            setAt(at + 1);
          }
        }}
      >
        {last ? "Done" : "Next"}
      </Button>
      {!last && (
        <Button variant="subtle" size="compact-sm" onClick={end}>
          Skip tour
        </Button>
      )}
    </section>
  );
}
