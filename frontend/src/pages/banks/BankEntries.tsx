/** Operating points of one bank: models, gains and M_s at the active λ, and links to the raw samples. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/RunState";
import { SignalName, SymbolText, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { dateTime, fixed, significant } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { bankDetailQuery } from "../../service/api/banks";
import { tuningKey } from "../../service/api/tuning";
import type { Bank, BankDetail, ChannelFit, LoopFigures } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Banks.module.css";
import { entryName, LOOPS, nameOf, percent } from "./BankTable";
import { TEXTS } from "./texts";

const FIGURES = ["K", "T", "k_p", "k_i"] as const;

type Lineage = BankDetail["entries"][number]["lineage"];

export function BankEntries({ bank }: { bank: Bank }) {
  const lambdas = useLive((live) => tuningKey(live.state?.tuning));
  const detail = useQuery(bankDetailQuery(bank.id, lambdas));
  const shownAt = detail.data
    ? fillText(TEXTS.shownAt, { lam_q: fixed(detail.data.lam_q, 3), lam_S: fixed(detail.data.lam_S, 3) })
    : (detail.error?.message ?? TEXTS.computing);
  return (
    <Card
      title={fillText(TEXTS.pointsOf, { bank: nameOf(bank) })}
      aside={<span className={page.dim}>{shownAt}</span>}
    >
      {bank.note !== "" && <p className={page.lead}>{bank.note}</p>}
      <div className={page.tableScroll}>
        <Table aria-label={TEXTS.operatingPoints} className={page.cards ?? ""}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.point}</Table.Th>
              <Table.Th className={page.number}>S [N·m/rad]</Table.Th>
              <Table.Th>{TEXTS.loop}</Table.Th>
              <Table.Th className={page.number}>
                <SignalName name="K" />
              </Table.Th>
              <Table.Th className={page.number}>
                <SignalName name="T" /> [s]
              </Table.Th>
              <Table.Th className={page.number}>
                <SignalName name="k_p" />
              </Table.Th>
              <Table.Th className={page.number}>
                <SignalName name="k_i" /> [1/s]
              </Table.Th>
              <Table.Th className={page.number}>
                <SignalName name="M_s" />
              </Table.Th>
              <Table.Th>{TEXTS.validationFit}</Table.Th>
              <Table.Th>{TEXTS.source}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {bank.entries.flatMap((entry, index) => {
              const figures = detail.data?.entries[index]?.figures;
              const models = {
                position: { K: entry.K_q, T: entry.T_q },
                stiffness: { K: entry.K_S, T: entry.T_S },
              };
              return LOOPS.map((loop) => (
                <Table.Tr key={`${entry.S_nominal} ${loop}`}>
                  {loop === "position" && (
                    <>
                      <Table.Td rowSpan={2} className={page.cardTitle ?? ""} style={{ whiteSpace: "nowrap" }}>
                        {entryName(entry)}
                      </Table.Td>
                      <Table.Td rowSpan={2} className={page.number}>
                        <Label name="S" />
                        {fixed(entry.S_nominal, 2)}
                      </Table.Td>
                    </>
                  )}
                  <Table.Td>
                    <SignalName name={loop === "position" ? "G_q" : "G_S"} />
                  </Table.Td>
                  <Figures figures={{ ...models[loop], ...figures?.[loop] }} why={shownAt} />
                  <Table.Td className={styles.fit ?? ""}>
                    <Fit fit={detail.data?.entries[index]?.lineage?.[loop]} />
                  </Table.Td>
                  {loop === "position" && (
                    <Table.Td rowSpan={2}>
                      <Source
                        identification={entry.identification}
                        lineage={detail.data?.entries[index]?.lineage ?? null}
                      />
                    </Table.Td>
                  )}
                </Table.Tr>
              ));
            })}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

/** `why` is the reason of an unknown gain. */
function Figures({ figures, why }: { figures: Partial<LoopFigures>; why: string }) {
  const unstable = figures.M_s === null;
  return (
    <>
      {FIGURES.map((name) => (
        <Table.Td key={name} className={page.number}>
          <Label name={name} />
          <ValueOrReason value={figures[name]} why={why}>
            {(value) => significant(value, 4)}
          </ValueOrReason>
        </Table.Td>
      ))}
      <Table.Td className={page.number}>
        <Label name="M_s" />
        {unstable ? (
          TEXTS.unstable
        ) : (
          <ValueOrReason value={figures.M_s} why={why}>
            {(value) => fixed(value, 3)}
          </ValueOrReason>
        )}
      </Table.Td>
    </>
  );
}

/** Label for narrow screens, on which the column has no header. */
function Label({ name }: { name: string }) {
  return (
    <span className={page.cardLabel} aria-hidden="true">
      <SymbolText name={name} />{" "}
    </span>
  );
}

/** Shows the fit of one model, from its own identification. */
function Fit({ fit }: { fit: ChannelFit | undefined }) {
  if (fit === undefined) return <span className={page.dim}>{TEXTS.unknown}</span>;
  const errors = fillText(TEXTS.standardErrors, {
    K: percent(fit.K_error_percent),
    T: percent(fit.T_error_percent),
  });
  return (
    <Verdict good={fit.grade === "usable"} of={`grade:${fit.grade}`}>
      {fillText(TEXTS.fitAndGrade, { fit: percent(fit.fit_percent), grade: fit.grade ?? TEXTS.noGrade })}
      <div className={styles.errors}>{errors}</div>
    </Verdict>
  );
}

/** Shows the source of an operating point, with links to its identification, run and parameters. */
function Source({ identification, lineage }: { identification: number | null; lineage: Lineage }) {
  if (identification === null) return <span className={page.dim}>{TEXTS.imported}</span>;
  return (
    <>
      <Link href={`/identify/${identification}`}>{fillText(TEXTS.identification, { identification })}</Link>
      {lineage && (
        <div className={page.dim}>
          {fillText(TEXTS.methodAndTime, {
            method: lineage.method,
            time: dateTime(lineage.created),
            person: lineage.who,
          })}
          <Link href={`/runs/${lineage.run}`}>{TEXTS.samples}</Link>
          {fillText(TEXTS.plantAndParameters, {
            plant: lineage.plant ?? TEXTS.notRecorded,
            parameters: lineage.parameters ?? TEXTS.notRecorded,
          })}
        </div>
      )}
    </>
  );
}
