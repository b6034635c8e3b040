/** Bringing a rig up, step by step: from drives off and a turn by hand to a safety module that was seen to trip. */

import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { capital } from "../../samples/words";
import { bringUpQuery } from "../../service/bringUp";
import { useMayCommand } from "../../service/useMayCommand";
import type { BringUp } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./BringUp.module.css";
import { Drives } from "./Drives";
import { StepCard } from "./StepCard";

export default function BringUpPage() {
  const { data, error } = useQuery(bringUpQuery);
  return (
    <div className={page.page}>
      <h1 className={page.title}>Bring-up</h1>
      {data?.applies ? (
        <Steps view={data} />
      ) : (
        <Nothing why={data?.why_not ?? error?.message ?? "Loading …"} />
      )}
    </div>
  );
}

function Nothing({ why }: { why: string }) {
  return (
    <Card title="Steps">
      <p className={page.empty}>{capital(why)}</p>
      <div className={styles.none}>
        <p>On a rig this page leads from drives off to a joint that may be driven:</p>
        <ol>
          <li>with drives off each sensor is turned or pulled by hand, and has to read what it should;</li>
          <li>the load cells are tared, and calibrated with known weights;</li>
          <li>the encoders count from where the joint is known to be, by hand or by its end switch;</li>
          <li>each motor is driven a little, and has to go to its side;</li>
          <li>the tendons are wound to the pretension, and the safety module is seen to cut the motors.</li>
        </ol>
        <p>
          <Link href="/docs/rig">The rig</Link> says what each step proves. The same steps can be tried
          without hardware on the virtual card.
        </p>
      </div>
    </Card>
  );
}

function Steps({ view }: { view: BringUp }) {
  const { steps, drives_on: on, drives_locked: locked, drives_left: left } = view;
  const viewer = useMayCommand() === false;
  const done = steps.filter(({ state }) => state === "current").length;
  const at = atStep(steps);
  const stepUnderWay = steps.some(({ running }) => running !== null);
  return (
    <>
      <p className={page.lead}>
        {done === steps.length ? "All" : done} of {steps.length} steps are done. Each is small, can be
        cancelled, and is kept with who did it and when.
        {viewer && " You are signed in as a viewer: you look on, and may press STOP."}
      </p>
      {on !== null && <Drives on={on} locked={locked} left={left} stepUnderWay={stepUnderWay} />}
      <ol className={styles.steps} aria-label="Steps of the bring-up">
        {steps.map((step, index) => (
          <li key={step.id}>
            <StepCard step={step} number={index + 1} open={index === at} />
          </li>
        ))}
      </ol>
    </>
  );
}

/** The step to look at: the one that runs, or else the first that is not done; -1 for none. */
function atStep(steps: BringUp["steps"]): number {
  const running = steps.findIndex((step) => step.running !== null);
  return running >= 0 ? running : steps.findIndex(({ state }) => state !== "current");
}
