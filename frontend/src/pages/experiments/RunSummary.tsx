/** All that an experiment is run with, or was, in two lines: its own settings, and the tuning. */

import { useQuery } from "@tanstack/react-query";
import { useAngles } from "../../service/angles";
import { banksQuery, experimentKindsQuery } from "../../service/queries";
import { tuningInWords } from "../../service/tuningWords";
import page from "../Page.module.css";
import { changesInWords, tuningChanges, type Values } from "./order";

interface RunSummaryProps {
  readonly name: string;
  readonly settings: Readonly<Record<string, unknown>>;
  /** Of an order that waits: the tuning in force, to which it is compared. */
  readonly inForce?: Values;
}

export function RunSummary({ name, settings, inForce }: RunSummaryProps) {
  const angles = useAngles();
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const { data: banks = [] } = useQuery(banksQuery);
  const kind = kinds.find((one) => one.name === name || one.name.startsWith(`${name}@`));
  const changes =
    kind === undefined || inForce === undefined ? "" : tuningChanges(settings, inForce, kind, angles);
  return (
    <span className={page.dim}>
      {kind === undefined ? "" : `${changesInWords(settings, kind, angles)}; tuning: `}
      {tuningInWords(settings, banks)}
      {changes !== "" && `; differs from the tuning in force: ${changes}`}
    </span>
  );
}
