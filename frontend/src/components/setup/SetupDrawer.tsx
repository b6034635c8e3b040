/** Setup steps from slack tendons to a report, each with its state: done, missing or out of date. */

import { Drawer } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { IconType } from "react-icons";
import { TbAlertTriangle, TbCircle, TbCircleCheck, TbCircleX } from "react-icons/tb";
import { Link } from "wouter";
import { dateTime } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { checklistQuery } from "../../service/api/system";
import type { ChecklistStep } from "../../wire/types";
import { TEXTS } from "../texts";
import styles from "./SetupDrawer.module.css";

type StepState = ChecklistStep["state"];

const STATES: Record<StepState, { word: string; Icon: IconType }> = {
  missing: { word: TEXTS.stepMissing, Icon: TbCircle },
  done: { word: TEXTS.stepDone, Icon: TbCircleCheck },
  outdated: { word: TEXTS.stepOutdated, Icon: TbAlertTriangle },
  unusable: { word: TEXTS.stepUnusable, Icon: TbCircleX },
};

interface StepText {
  readonly title: string;
  readonly path: string;
  readonly action: string;
  /** Anchor of the section of the tutorial that explains the step. */
  readonly section: string;
}

export const STEPS: Record<string, StepText> = {
  pretension: {
    title: TEXTS.pretension,
    path: "/operate",
    action: TEXTS.pretensionAction,
    section: "pretension",
  },
  motor: {
    title: TEXTS.motor,
    path: "/identify",
    action: TEXTS.motorAction,
    section: "identify-the-motors",
  },
  spring: {
    title: TEXTS.spring,
    path: "/identify",
    action: TEXTS.springAction,
    section: "identify-the-springs",
  },
  actuator: {
    title: TEXTS.actuator,
    path: "/identify",
    action: TEXTS.actuatorAction,
    section: "identify-the-actuator",
  },
  bank: {
    title: TEXTS.bank,
    path: "/banks",
    action: TEXTS.bankAction,
    section: "build-a-bank",
  },
  tuning: { title: TEXTS.tuning, path: "/operate", action: TEXTS.tuningAction, section: "tune" },
  experiment: {
    title: TEXTS.experiment,
    path: "/experiments",
    action: TEXTS.experimentAction,
    section: "run-an-experiment",
  },
  report: {
    title: TEXTS.report,
    path: "/experiments",
    action: TEXTS.reportAction,
    section: "read-the-report",
  },
};

export function SetupDrawer({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  const { data, error } = useQuery({ ...checklistQuery, enabled: opened });
  return (
    <Drawer
      opened={opened}
      onClose={onClose}
      title={TEXTS.setup}
      position="left"
      size={420}
      padding="md"
      offset={0}
      styles={{ content: { paddingTop: "var(--header)" } }}
    >
      {data === undefined ? (
        <p>{error?.message ?? TEXTS.loading}</p>
      ) : (
        <ol className={styles.steps} aria-label={TEXTS.setupSteps}>
          {data.map((step) => (
            <Step key={step.name} step={step} onFollowed={onClose} />
          ))}
        </ol>
      )}
    </Drawer>
  );
}

function Step({ step, onFollowed }: { step: ChecklistStep; onFollowed: () => void }) {
  const { word, Icon } = STATES[step.state];
  const about = STEPS[step.name] ?? {
    title: step.name,
    path: "/operate",
    action: TEXTS.setupOpen,
    section: "",
  };
  return (
    <li
      className={styles.step}
      data-state={step.state}
      aria-label={fillText(TEXTS.setupStep, { step: about.title, state: word })}
    >
      <Icon size={20} aria-hidden="true" className={styles.icon} />
      <div>
        <div className={styles.head}>
          <strong>{about.title}</strong>
          <span className={styles.word}>{word}</span>
        </div>
        <p className={styles.detail}>
          {step.detail}
          {step.at !== null && <span className={styles.when}> {dateTime(step.at)}</span>}
        </p>
        <div className={styles.links}>
          {step.state !== "done" && !(step.name === "report" && step.run === null) && (
            <Link
              href={step.run !== null && step.name === "report" ? `/runs/${step.run}` : about.path}
              onClick={onFollowed}
            >
              {about.action}
            </Link>
          )}
          <Link
            href={`/docs/first-hour/${about.section}`}
            aria-label={fillText(TEXTS.setupHowTo, { step: about.title })}
            onClick={onFollowed}
          >
            {TEXTS.setupHow}
          </Link>
          {step.run !== null && step.state === "done" && (
            <Link href={`/runs/${step.run}`} onClick={onFollowed}>
              {fillText(TEXTS.setupRun, { run: step.run })}
            </Link>
          )}
        </div>
      </div>
    </li>
  );
}
