/** The way from slack tendons to a report, with what is done, missing and out of date. */

import { Drawer } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { IconType } from "react-icons";
import { TbAlertTriangle, TbCircle, TbCircleCheck, TbCircleX } from "react-icons/tb";
import { Link } from "wouter";
import { dateTime } from "../../samples/format";
import { checklistQuery } from "../../service/api/system";
import type { ChecklistStep } from "../../wire/types";
import styles from "./SetupDrawer.module.css";

type StepState = ChecklistStep["state"];

const STATES: Record<StepState, { word: string; Icon: IconType }> = {
  missing: { word: "to do", Icon: TbCircle },
  done: { word: "done", Icon: TbCircleCheck },
  outdated: { word: "out of date", Icon: TbAlertTriangle },
  unusable: { word: "not usable", Icon: TbCircleX },
};

interface StepText {
  readonly title: string;
  readonly path: string;
  readonly action: string;
  /** The part of the document about the first hour that tells how, and why. */
  readonly told: string;
}

export const STEPS: Record<string, StepText> = {
  pretension: { title: "Pretension", path: "/operate", action: "Wind the tendons up", told: "pretension" },
  motor: {
    title: "Motor identification",
    path: "/identify",
    action: "Identify the motors",
    told: "identify-the-motors",
  },
  spring: {
    title: "Spring identification",
    path: "/identify",
    action: "Identify the springs",
    told: "identify-the-springs",
  },
  actuator: {
    title: "Actuator identification",
    path: "/identify",
    action: "Identify the actuator",
    told: "identify-the-actuator",
  },
  bank: {
    title: "Controller bank",
    path: "/banks",
    action: "Build or activate a bank",
    told: "build-a-bank",
  },
  tuning: { title: "Tuning", path: "/operate", action: "Choose λ and save it", told: "tune" },
  experiment: {
    title: "Experiment",
    path: "/experiments",
    action: "Run an experiment",
    told: "run-an-experiment",
  },
  report: { title: "Report", path: "/experiments", action: "Open the report", told: "read-the-report" },
};

export function SetupDrawer({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  const { data, error } = useQuery({ ...checklistQuery, enabled: opened });
  return (
    <Drawer
      opened={opened}
      onClose={onClose}
      title="Set-up"
      position="left"
      size={420}
      padding="md"
      offset={0}
      styles={{ content: { paddingTop: "var(--header)" } }}
    >
      {data === undefined ? (
        <p>{error?.message ?? "Loading …"}</p>
      ) : (
        <ol className={styles.steps} aria-label="Steps of the set-up">
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
  const about = STEPS[step.name] ?? { title: step.name, path: "/operate", action: "Open", told: "" };
  return (
    <li className={styles.step} data-state={step.state} aria-label={`${about.title}: ${word}`}>
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
        <div className={styles.ways}>
          {step.state !== "done" && !(step.name === "report" && step.run === null) && (
            <Link
              href={step.run !== null && step.name === "report" ? `/runs/${step.run}` : about.path}
              onClick={onFollowed}
            >
              {about.action}
            </Link>
          )}
          <Link
            href={`/docs/first-hour/${about.told}`}
            aria-label={`${about.title}: how, and why`}
            onClick={onFollowed}
          >
            How
          </Link>
          {step.run !== null && step.state === "done" && (
            <Link href={`/runs/${step.run}`} onClick={onFollowed}>
              Run {step.run}
            </Link>
          )}
        </div>
      </div>
    </li>
  );
}
