/** Criteria with pass or fail, and metrics, as tables. */

import { Table } from "@mantine/core";
import { Explained } from "../../components/Explained";
import { Unit } from "../../components/Unit";
import { Verdict } from "../../components/Verdict";
import { measured, NOT_MEASURED } from "../../samples/format";
import { type Angles, inWords, readingNear, readingOf, told } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { figureEntry } from "../../service/glossary";
import type { Criterion, Metric } from "../../wire/types";
import page from "../Page.module.css";

interface FiguresProps {
  readonly criteria: readonly Criterion[];
  readonly metrics: readonly Metric[];
  /** LocalizedText in the names of the tables where it is not the experiment itself. */
  readonly of?: string;
}

export function Figures({ criteria, metrics, of }: FiguresProps) {
  const angles = useAngles();
  const named = (name: string) => (of === undefined ? name : `${name} of the ${of}`);
  return (
    <div className={page.halves}>
      {criteria.length > 0 && (
        <Table aria-label={named("Criteria")} verticalSpacing={4}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Criterion</Table.Th>
              <Table.Th className={page.number}>Value</Table.Th>
              <Table.Th>Bound</Table.Th>
              <Table.Th>Result</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {criteria.map((criterion) => (
              <Table.Tr key={criterion.name}>
                <Table.Td>
                  <Explained of={`figure:${criterion.name}`}>{criterion.label}</Explained>
                </Table.Td>
                <Table.Td className={page.number}>{figure(criterion, 3, angles)}</Table.Td>
                <Table.Td style={{ whiteSpace: "nowrap" }}>
                  {criterion.relation} {told(criterion.bound, criterion.unit, angles)}
                </Table.Td>
                <Table.Td>
                  <Outcome passed={criterion.passed} />
                  <Reason
                    text={criterion.reason}
                    seen={criterion.passed === false ? SEEN[criterion.relation] : undefined}
                  />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
      {metrics.length > 0 && (
        <Table aria-label={named("Metrics")} verticalSpacing={4}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Metric</Table.Th>
              <Table.Th className={page.number}>Value</Table.Th>
              <Table.Th>Unit</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {metrics.map((metric) => (
              <Table.Tr key={metric.name}>
                <Table.Td>
                  <Explained of={figureEntry(metric)}>{metric.label}</Explained>
                  <Reason text={metric.reason} seen={metric.value === null ? undefined : SEEN["<"]} />
                </Table.Td>
                <Table.Td className={page.number}>
                  {measured(
                    metric.value === null
                      ? null
                      : metric.value * readingNear(metric.value, metric.unit, angles).factor,
                    4,
                  )}
                </Table.Td>
                <Table.Td>
                  <Unit unit={metric.unit} near={metric.value ?? undefined} />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
    </div>
  );
}

/** A figure in SI as the person reads its unit. */
function figure(
  { value, unit }: { value: number | null; unit: string },
  digits: number,
  angles: Angles,
): string {
  return measured(value === null ? null : value * readingOf(unit, angles).factor, digits);
}

function Outcome({ passed }: { passed: boolean | null }) {
  if (passed === null) {
    return (
      <Explained of="criterion:not_measured" quiet>
        {NOT_MEASURED}
      </Explained>
    );
  }
  const word = passed ? "pass" : "fail";
  return (
    <Verdict good={passed} of={`criterion:${word}`}>
      {word}
    </Verdict>
  );
}

/** What a figure that was not seen whole is, by the relation to its bound. */
export const SEEN: Record<string, string> = { "<": "at least this", ">": "at most this" };

/** Why there is no figure, or why it is that of a part only; `seen` says what it is then. */
export function Reason({ text, seen }: { text: string; seen?: string | undefined }) {
  const angles = useAngles();
  if (text === "") return null;
  return (
    <div className={page.dim}>
      {seen === undefined ? "" : `${seen}: `}
      {inWords(text, angles)}
    </div>
  );
}
